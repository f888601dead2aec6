# The daemon loses the camera and finds it again, and draws new frames after it. Counted in frames of the camera: some 60 find its
# response the first time, 24 tell the delay of its control each time it is opened, and some 20 pass while the slow guest draws one.
. /host/guest/steps.sh
camera_in
needs_video_driver
ask camera set pictures=desk lag=2
ask camera fault unplug=200
mkdir -p /tmp/pictures
halflightd --set 'device.camera="v4l2:/dev/video0,size=320x240"' --set 'output.pictures="/tmp/pictures"' >/tmp/daemon 2>&1 &
daemon=$!
lives() { kill -0 $daemon 2>/dev/null || { cat /tmp/daemon; echo "the daemon ended $1"; exit 1; }; }
pictures() { ls /tmp/pictures | grep -c png || true; }
until [ ! -e /dev/video0 ]; do
    lives "before the camera was pulled out"
    sleep 0.1
done
until grep -q 'is waited for' /tmp/daemon; do
    lives "when the camera was pulled out"
    sleep 0.1
done
before=$(pictures)
[ "$before" -gt 0 ] || { cat /tmp/daemon; echo "no picture before the camera was pulled out"; exit 1; }
made=$(ask camera made)
camera_in
# Two may be of frames from before: one is being drawn, one waits.
until [ "$(pictures)" -ge $((before + 4)) ]; do
    lives "after the camera was plugged in again"
    sleep 0.1
done
after=$(($(ask camera made) - made))
kill -TERM $daemon
wait $daemon || { cat /tmp/daemon; echo "the daemon failed"; exit 1; }
[ "$after" -le 250 ] || { cat /tmp/daemon; echo "$after frames after the loss"; exit 1; }
echo "$before pictures before the loss; $after frames of the camera until there were four new ones"
