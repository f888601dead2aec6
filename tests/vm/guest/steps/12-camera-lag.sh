# A setting written after a frame comes into force exactly k + 1 frames later; with jitter between two bounds.
. /host/guest/steps.sh
camera_in
for k in 0 1 3; do
    ask camera set lag=$k
    agent capture /dev/video0 frames=8 one lag=$((k + 1))-$((k + 1)) out=/host/out/lag
    ask camera check out/lag
done
ask camera set lag=1 jitter=2
agent capture /dev/video0 frames=20 one lag=2-5
