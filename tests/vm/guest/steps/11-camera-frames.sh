# Every frame arrives as it was sent, with a setting written after each.
. /host/guest/steps.sh
camera_in
agent capture /dev/video0 frames=20 out=/host/out/frames lag=3-8
same "$(ask camera check out/frames)" 20 "frames that are right"
agent capture /dev/video0 frames=3 size=640x480 out=/host/out/large
ask camera check out/large
