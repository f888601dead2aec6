# The daemon loses the camera and finds it again; it draws new frames after it.
. /host/guest/steps.sh
camera_in
needs_video_driver
ask camera set pictures=desk lag=2
ask camera fault unplug=8
halflightd --set 'device.camera="v4l2:/dev/video0"' --set device.frames=16 >/tmp/daemon 2>&1 &
daemon=$!
until_true [ ! -e /dev/video0 ]
made=$(ask camera made)
camera_in
wait $daemon || { cat /tmp/daemon; exit 1; }
# Counted in frames: those after the loss are what the first eight lack, and a few that show the room anew.
after=$(($(ask camera made) - made))
[ "$after" -le 24 ] || { echo "$after frames after the loss"; exit 1; }
echo "$after frames after the loss"
