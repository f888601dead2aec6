# A short frame is a gap in the driver's count; a frame that the camera never sent is none; silence is no error.
. /host/guest/steps.sh
camera_in
ask camera fault short=3
agent capture /dev/video0 frames=6 lost=1,1 out=/host/out/short
ask camera check out/short
ask camera fault drop=4
agent capture /dev/video0 frames=6 lost=0,1 out=/host/out/drop
ask camera check out/drop
ask camera fault silent=5
agent capture /dev/video0 silent
