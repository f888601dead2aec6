# The programs of the release build start, and a replay in the guest is the host's, pixel for pixel.
. /host/guest/steps.sh
halflight --version
halflightd --version
halflight replay /host/recordings/desk.mcap --frames 2 --digest --quiet >/tmp/replay
same "$(digest_of /tmp/replay)" "$(ask host replay recordings/desk.mcap 2)" "guest and host"
echo "$(halflight --version | head -n 1): guest and host draw the same"
