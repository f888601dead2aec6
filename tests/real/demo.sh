#!/usr/bin/env bash
# make demo-real: the tool on real photographs. Usage: demo.sh PROGRAM OUT. Needs the shared test data.
set -euo pipefail
program=$1
out=$2
here=$(cd "$(dirname "$0")" && pwd)
shared=${HALFLIGHT_SHARED:-$here/../../../shared}
[ -f "$shared/data/README.md" ] || { echo "demo-real: no shared test data at $shared; set HALFLIGHT_SHARED" >&2; exit 2; }
mkdir -p "$out"

echo "== HDR from 16 exposures (memorial)"
names=() times=()
while read -r name seconds _; do
    case $name in '#'*|'') continue ;; esac
    names+=("$shared/data/brackets/memorial/$name") times+=("$seconds")
done <"$shared/data/brackets/memorial/image_list.txt"
# Nine of them span all brightness.
pick_names=() pick_times=()
for i in 0 2 4 6 8 10 12 14 15; do pick_names+=("${names[$i]}") pick_times+=("${times[$i]}"); done
"$program" hdr --times "$(IFS=,; echo "${pick_times[*]}")" "${pick_names[@]}" --out "$out/memorial.exr"

echo "== Stated times that the pixels contradict (living room)"
"$program" hdr --times 4,1,0.25 "$shared"/data/brackets/living_room1_negative/DSC_00{71,73,75}.png --out "$out/living_room.exr"

echo "== Tags in a photograph"
"$program" tags "$shared/data/apriltag/duckie/test_image_rotation_30.png" --focal 329.87,332.95,528.5,396.5 --size 0.065

echo "== Light of an angular map and of an equirectangular picture"
"$program" light "$shared/data/hdr/debevec_beach_probe_angular.hdr" --as angular --order 4
"$program" light "$shared/data/hdr/rooitou_park_1k.hdr" --as equirect --order 4

echo "== A robot on the pouf, in the light that the mirror ball saw"
# Many maps: the lamps and the window are wide, and their shadows soft.
"$program" render "$here/ola.toml" --shadow-maps 32 --out "$out/robot_on_pouf.png"
echo "results in $out"
