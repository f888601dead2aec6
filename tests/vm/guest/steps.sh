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
