# A camera behind libcamera: 10 frames, each with the exposure that it truly had. On USB libcamera 0.0.3 states no exposures, so the
# product tells them from the pictures, as it does with V4L2.
. /host/guest/steps.sh
if ! halflight --version | grep -q '^cameras:.*libcamera'; then
    echo "this build is without libcamera"
    exit 77
fi
camera_in
# libcamera lists what udev's database calls ready. The guest has no udevd: the lines that it would write are enough.
mkdir -p /run/udev/data /tmp/kept
for node in /sys/class/video4linux/*/dev /sys/bus/media/devices/*/dev; do echo I:1 >"/run/udev/data/c$(cat "$node")"; done
ask camera set pictures=desk lag=2
HALFLIGHT_LOG=debug halflight record libcamera: --frames 10 --raw --force --out /host/out/sensor.mcap --digest --exposures-s 0.002,0.007,0.02 >/tmp/kept/record 2>/tmp/kept/said || { cat /tmp/kept/said; exit 1; }
same "$(digest_of /tmp/kept/record)" "$(ask host pictures out/sensor.mcap)" "pictures recorded"
same "$(ask host attributions out/sensor.mcap)" 10 "exposures that are right"
grep -q 'metadata states no exposure' /tmp/kept/said || { cat /tmp/kept/said; echo "the log does not say that no exposure is stated"; exit 1; }
echo "$(grep '^exposures' /tmp/kept/record): 10 frames with true exposures"
