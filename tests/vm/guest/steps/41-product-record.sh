# What the tool records is what the camera sent, with the exposures that it truly had; its replay is the same here and there.
. /host/guest/steps.sh
camera_in
needs_video_driver
ask camera set pictures=desk lag=2
mkdir -p /tmp/kept
HALFLIGHT_LOG=debug halflight record v4l2:/dev/video0 --frames 20 --raw --force --out /host/out/product.mcap --digest --exposures-s 0.002,0.007,0.02 >/tmp/kept/record 2>/tmp/kept/said || { cat /tmp/kept/said; exit 1; }
same "$(digest_of /tmp/kept/record)" "$(ask host pictures out/product.mcap)" "pictures recorded"
same "$(ask host attributions out/product.mcap)" 20 "exposures that are right"
halflight replay /host/out/product.mcap --frames 4 --digest --quiet >/tmp/kept/replay
same "$(digest_of /tmp/kept/replay)" "$(ask host replay out/product.mcap 4)" "guest and host"
# Brackets on a real driver: each of the three exposures is in the recording, and none but those.
exposures=$(grep '^exposures' /tmp/kept/record)
[ "$(echo "$exposures" | tr ',' '\n' | wc -l)" = 3 ] || { cat /tmp/kept/record /tmp/kept/said; echo "not three exposures: $exposures"; exit 1; }
grep -q 'response was found' /tmp/kept/said || { cat /tmp/kept/said; echo "the response was not looked for"; exit 1; }
echo "$exposures: 20 frames with true exposures; the replay is the same in guest and host"
