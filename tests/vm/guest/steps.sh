# What the steps share. A step ends with status 0 where it passed, 77 where it was skipped; its last line says what was seen.
agent() { halflight-vm-agent "$@"; }
# What was written to the shared folder is there before the harness looks.
ask() {
    sync
    halflight-vm-agent ask "$@"
}

# Waits for something that must come. It takes as long as it takes; the step's own limit ends it.
until_true() { until "$@"; do sleep 0.1; done; }

camera_in() {
    ask camera plug
    until_true [ -c /dev/video1 ]
}

camera_out() {
    ask camera unplug
    until_true [ ! -e /dev/video0 ]
}

# Skips the step while the product has no driver for such cameras.
needs_video_driver() {
    if halflight record v4l2:/dev/video0 --frames 1 --out /tmp/probe.mcap 2>&1 | grep -q 'unknown kind of device'; then
        echo "the product has no v4l2 camera yet"
        exit 77
    fi
    rm -f /tmp/probe.mcap
}

digest_of() { grep '^digest ' "$1" | cut -d ' ' -f 2; }
same() { [ "$1" = "$2" ] || { echo "$3: $1 and $2"; exit 1; }; }

# Runs the daemon with an inertial sensor, cuts that, gives it back: imu_lost_and_back NAME CUT PLUG [MORE..]. The daemon must say
# both, and draw all the time. What was seen is in $told.
imu_lost_and_back() {
    imu=$1 cut=$2 plug=$3
    shift 3
    rm -rf /tmp/kept/pictures
    mkdir -p /tmp/kept/pictures
    HALFLIGHT_LOG=info halflightd --set 'device.camera="v4l2:/dev/video0,size=320x240"' --set 'camera.exposures_s=[0.005]' --set "device.imu=\"$imu\"" \
        --set 'output.pictures="/tmp/kept/pictures"' "$@" >/tmp/kept/daemon 2>&1 &
    daemon=$!
    said() { kill -0 $daemon 2>/dev/null || { cat /tmp/kept/daemon; echo "the daemon ended"; exit 1; }; grep -q "$1" /tmp/kept/daemon; }
    drawn() { ls /tmp/kept/pictures | grep -c png || true; }
    more_than() { said running && [ "$(drawn)" -gt "$1" ]; }
    waits() {
        left=3000
        until "$@"; do
            left=$((left - 1))
            [ $left -gt 0 ] || { tail -n 20 /tmp/kept/daemon; echo "waited in vain for: $*"; exit 1; }
            sleep 0.1
        done
    }
    waits more_than 0
    $cut
    waits said 'IMU is lost'
    waits more_than "$(drawn)"
    $plug
    waits said 'IMU is back'
    waits more_than "$(drawn)"
    kill -TERM $daemon
    wait $daemon || { cat /tmp/kept/daemon; echo "the daemon failed"; exit 1; }
    told="lost and back, $(drawn) pictures"
}
