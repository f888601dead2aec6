# An inertial sensor as hidraw, pulled out and put back: no sample is lost.
. /host/guest/steps.sh
agent hidraw 200 2
