# The daemon reads inertial sensors through HID, as hidraw and as the kernel's IIO devices, loses each, and finds it again.
. /host/guest/steps.sh
camera_in
mkdir -p /tmp/kept
cat >/tmp/kept/imu.toml <<'END'
[imu]
protocol = "described"
rate_hz = 200

[imu.frame]
header = []
length = 21
checksum = "none"
counter = { offset = 1, type = "u32le" }

[[imu.field]]
offset = 9
type = "i16le"
scale = 0.001
to = "gyro.x"
[[imu.field]]
offset = 11
type = "i16le"
scale = 0.001
to = "gyro.y"
[[imu.field]]
offset = 13
type = "i16le"
scale = 0.001
to = "gyro.z"
[[imu.field]]
offset = 15
type = "i16le"
scale = 0.01
to = "accel.x"
[[imu.field]]
offset = 17
type = "i16le"
scale = 0.01
to = "accel.y"
[[imu.field]]
offset = 19
type = "i16le"
scale = 0.01
to = "accel.z"
END
feed() { rm -f /tmp/kept/stop; halflight-vm-agent $1-feed /tmp/kept/stop >/dev/null 2>&1 & }
cut() { touch /tmp/kept/stop; }
feed hidraw
until_true ls /dev/hidraw0
imu_lost_and_back "hid:1d6b:0201" cut "feed hidraw" --set 'device.imu_file="/tmp/kept/imu.toml"'
cut
all=$told
until_true [ ! -e /dev/hidraw0 ]
feed iio
until_true ls /dev/iio:device0
imu_lost_and_back "iio:name=dev_rotation" cut "feed iio"
cut
echo "hidraw: $all; IIO: $told"
