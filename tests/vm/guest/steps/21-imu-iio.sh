# A sensor hub as IIO, pulled out and put back.
. /host/guest/steps.sh
agent iio 40 2
