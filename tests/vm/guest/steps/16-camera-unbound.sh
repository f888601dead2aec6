# The driver is taken from the camera and given back.
. /host/guest/steps.sh
camera_in
driver=/sys/bus/usb/drivers/uvcvideo
interface=$(basename "$(ls -d $driver/*:1.0)")
before=$(ask camera made)
made_five() { [ "$(ask camera made)" -ge $((before + 5)) ]; }
agent capture /dev/video0 gone out=/host/out/bound >/tmp/bound &
until_true made_five
echo "$interface" >$driver/unbind
wait $! || { cat /tmp/bound; exit 1; }
cat /tmp/bound
ask camera check out/bound
until_true [ ! -e /dev/video0 ]
echo "$interface" >$driver/bind
until_true [ -c /dev/video1 ]
agent capture /dev/video0 frames=5 out=/host/out/again
same "$(ask camera check out/again)" 5 "frames after it"
