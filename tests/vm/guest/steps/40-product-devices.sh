# The tool lists the camera.
. /host/guest/steps.sh
camera_in
needs_video_driver
halflight devices | grep -q video0
echo "video0 is listed"
