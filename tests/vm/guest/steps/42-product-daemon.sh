# The daemon loses the camera and finds it again; it draws new frames after it. The first frames of an open camera tell the
# delay of its control and are left out (24 and some), so it draws 20 before the camera is pulled out, and 20 after it is back.
. /host/guest/steps.sh
camera_in
needs_video_driver
ask camera set pictures=desk lag=2
ask camera fault unplug=60
timeout 400 halflightd --set 'device.camera="v4l2:/dev/video0"' --set device.frames=60 >/tmp/daemon 2>&1 &
daemon=$!
until [ ! -e /dev/video0 ]; do
    kill -0 $daemon 2>/dev/null || { cat /tmp/daemon; echo "the daemon ended before the camera was pulled out"; exit 1; }
    sleep 0.1
done
made=$(ask camera made)
camera_in
wait $daemon || { cat /tmp/daemon; echo "the daemon failed"; exit 1; }
# Counted in frames: what the daemon lacked, the first frames of an open camera, and a few that show the room anew.
after=$(($(ask camera made) - made))
[ "$after" -le 120 ] || { cat /tmp/daemon; echo "$after frames after the loss"; exit 1; }
echo "$after frames after the loss"
