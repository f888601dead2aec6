# The camera is pulled out after five frames and put back: it is seen, and the first frame after it is whole.
. /host/guest/steps.sh
camera_in
ask camera fault unplug=5
agent capture /dev/video0 gone out=/host/out/before
ask camera check out/before
until_true [ ! -e /dev/video0 ]
before=$(ask camera made)
camera_in
agent capture /dev/video0 frames=5 out=/host/out/after
same "$(ask camera check out/after)" 5 "frames after it"
same "$(sed -n '1s/frame [0-9]* \([0-9]*\) .*/\1/p' /host/out/after)" "$before" "the first frame after it"
