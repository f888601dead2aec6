# The kernel's test camera in all formats, by the calls of one plane and of several: each gives the picture that RGB gives. Bayer
# values of this camera are coded, which a sensor's are not: they are held against one another.
. /host/guest/steps.sh
camera_out
loaded=
alike() {
    differs=$(ask host alike "out/$1.mcap" "out/$2.mcap")
    [ "$differs" -le "$3" ] || { echo "$2 differs from $1 by $differs in the mean, planes $planes"; exit 1; }
}
for planes in 1 2; do
    while read -r module; do
        [ "$module" = vivid ] || [ -n "$loaded" ] || insmod "/modules/$module.ko" || { echo "no module $module"; exit 1; }
    done </modules/vivid.order
    loaded=yes
    insmod /modules/vivid.ko n_devs=1 node_types=0x1 num_inputs=1 input_types=0 multiplanar=$planes
    until_true [ -c /dev/video0 ]
    case $planes in
    1) coded="YUYV NV12 GREY" raw="BG10 RG16" ;;
    2) coded="YUYV UYVY" raw="GB12" ;;
    esac
    for format in RGB3 $coded RGGB $raw; do
        HALFLIGHT_LOG=debug halflight record "v4l2:/dev/video0,size=320x180,format=$format" --frames 2 --raw --force --out /host/out/$format.mcap --exposures-s 0.01 >/tmp/kept.$format 2>&1 || { cat /tmp/kept.$format; echo "$format, planes $planes"; exit 1; }
        grep -q 'buffers, [1-9][0-9]* of them exported as DMA-BUF' /tmp/kept.$format || { cat /tmp/kept.$format; echo "$format: no DMA-BUF"; exit 1; }
    done
    for format in $coded; do alike RGB3 $format 3; done
    for format in $raw; do alike RGGB $format 3; done
    rmmod vivid
done
echo "nine formats, by one plane and by several, exported as DMA-BUF"
