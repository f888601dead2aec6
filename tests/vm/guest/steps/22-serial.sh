# A serial line, cut and put back: bytes there and back, samples without a loss.
. /host/guest/steps.sh
line=/dev/ttyUSB0
in_use() {
    until_true [ -c $line ]
    stty -F $line raw -echo
}
ask serial echo
in_use
agent serial-echo $line
ask serial cut
until_true [ ! -e $line ]
for first in 0 300; do
    ask serial samples first=$first count=300
    in_use
    agent serial-samples $line $first 300
    until_true [ ! -e $line ]
done
echo "256 bytes there and back, twice 300 samples, each cut seen"
