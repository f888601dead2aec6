# The camera is two nodes; its controls have their ranges, and writes end up within them.
. /host/guest/steps.sh
camera_in
agent nodes
