# The tool records an inertial sensor on a serial line beside the camera: no sample is lost or changed. The daemon loses the sensor
# and finds it again.
. /host/guest/steps.sh
camera_in
ask serial rvc
until_true [ -c /dev/ttyUSB0 ]
mkdir -p /tmp/kept
imu=serial:/dev/ttyUSB0,protocol=rvc
HALFLIGHT_LOG=info halflight record v4l2:/dev/video0 --exposures-s 0.005 --imu $imu --frames 8 --raw --force --out /host/out/imu.mcap >/tmp/kept/record 2>&1 || { cat /tmp/kept/record; exit 1; }
count=$(ask host forces out/imu.mcap) || { cat /tmp/kept/record; echo "$count"; exit 1; }
[ "$count" -ge 20 ] || { cat /tmp/kept/record; echo "only $count samples"; exit 1; }
imu_lost_and_back "$imu" "ask serial cut" "ask serial rvc"
echo "$count samples beside 8 frames, as they were sent; $told"
