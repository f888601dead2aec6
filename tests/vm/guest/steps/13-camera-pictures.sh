# The camera shows a bundled recording, as bright as its exposures make it.
. /host/guest/steps.sh
ask camera set pictures=desk
camera_in
agent capture /dev/video0 frames=6 out=/host/out/desk
ask camera check out/desk
