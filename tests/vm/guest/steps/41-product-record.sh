# What the tool records is what the camera sent, with the exposures that it truly had; its replay is the same here and there.
. /host/guest/steps.sh
camera_in
needs_video_driver
ask camera set pictures=desk lag=2
mkdir -p /tmp/kept
halflight record v4l2:/dev/video0 --frames 20 --raw --force --out /host/out/product.mcap --digest >/tmp/kept/record
same "$(digest_of /tmp/kept/record)" "$(ask host pictures out/product.mcap)" "pictures recorded"
same "$(ask host attributions out/product.mcap)" 20 "exposures that are right"
halflight replay /host/out/product.mcap --frames 4 --digest --quiet >/tmp/kept/replay
same "$(digest_of /tmp/kept/replay)" "$(ask host replay out/product.mcap 4)" "guest and host"
# The pictures' curve is not sRGB, so brackets may be given up: one exposure for all frames proves little, and is said.
echo "$(grep '^exposures' /tmp/kept/record): 20 frames with true exposures; the replay is the same in guest and host"
