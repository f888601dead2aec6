#!/usr/bin/env bash
# Makes the guest of `make test-vm` in target/vm: Debian's own kernel and a small initramfs with busybox and the modules that the
# steps need. Both packages are downloaded and unpacked, never installed. Nothing is done where the inputs are as they were.
set -euo pipefail
cd "$(dirname "$0")/../.."
guest=target/vm
mkdir -p "$guest"

# What the steps need; what these need is found below. In this order they are loaded.
MODULES=(virtio_pci 9p 9pnet_virtio xhci_pci uvcvideo hid hid-generic uhid
    hid-sensor-hub hid-sensor-accel-3d hid-sensor-gyro-3d hid-sensor-rotation ftdi_sio)

# What a step loads by itself: it would be in the way of others.
LATER=(vivid)

fail() {
    echo "$*" >&2
    exit 1
}

# The package that the name without a version stands for today.
kernel=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/.*Depends: \(linux-image-[0-9][^ ]*\)$/\1/p' | head -n 1)
[ -n "$kernel" ] || fail "no package linux-image-amd64 is known: run apt-get update (Debian, amd64)"
version=$(apt-cache policy "$kernel" | sed -n 's/ *Candidate: //p')
stamp=$(echo "$kernel $version" | cat - tests/vm/make-guest.sh tests/vm/guest/init | sha256sum)
[ "$(cat "$guest/stamp" 2>/dev/null)" != "$stamp" ] || exit 0

rm -rf "$guest/packages" "$guest/tree" "$guest/root" "$guest/stamp"
mkdir -p "$guest/packages" "$guest/tree" "$guest/root"/{bin,proc,sys,dev,tmp,host,modules}
# The downloading user of apt cannot reach a folder of root's.
(cd "$guest/packages" && apt-get download -qq -o APT::Sandbox::User=root "$kernel" busybox-static) ||
    fail "$kernel and busybox-static cannot be downloaded"

wanted=(./boot/vmlinuz-*)
for folder in drivers/{hid,usb,media,iio,virtio,i2c,acpi,video} fs net/9p lib; do wanted+=("./lib/modules/*/kernel/$folder/*"); done
dpkg-deb --fsys-tarfile "$guest/packages/$kernel"_*.deb | tar -x -C "$guest/tree" --wildcards "${wanted[@]}"
dpkg-deb --fsys-tarfile "$guest/packages"/busybox-static_*.deb | tar -x -C "$guest/tree" ./bin/busybox

# Modules by name, with `_` and `-` alike.
declare -A file_of loaded
while IFS= read -r file; do
    name=$(basename "$file" .ko)
    file_of[${name//-/_}]=$file
done < <(find "$guest/tree/lib" -name '*.ko')

# Copies a module after those that it needs, and writes down the order in $order. What is no file is built into the kernel.
order=order
add() {
    local name=${1//-/_} needed
    local file=${file_of[$name]:-}
    [ -z "${loaded[$name]:-}" ] || return 0
    [ -n "$file" ] || fail "the kernel package has no module $name"
    loaded[$name]=1
    for needed in $(tr '\0' '\n' <"$file" | sed -n 's/^depends=//p' | tr ',' ' '); do add "$needed"; done
    cp "$file" "$guest/root/modules/$name.ko"
    echo "$name" >>"$guest/root/modules/$order"
}
for name in "${MODULES[@]}"; do add "$name"; done
for name in "${LATER[@]}"; do order=$name.order && add "$name"; done

cp "$guest/tree/bin/busybox" "$guest/root/bin/busybox"
ln -s busybox "$guest/root/bin/sh"
install -m 755 tests/vm/guest/init "$guest/root/init"
busybox=$PWD/$guest/root/bin/busybox
(cd "$guest/root" && find . | "$busybox" cpio -o -H newc 2>/dev/null | gzip -1) >"$guest/initramfs"
cp "$guest/tree/boot"/vmlinuz-* "$guest/kernel.new"
rm -rf "$guest/kernel" "$guest/tree" "$guest/packages" "$guest/root"
mv "$guest/kernel.new" "$guest/kernel"
echo "$stamp" >"$guest/stamp"
echo "The guest is made: $kernel $version, initramfs of $(stat -c %s "$guest/initramfs") bytes"
