#!/usr/bin/env bash
# Build the guest: a small Debian 12 with systemd, udev, Python and the stock kernel, as kernel + initramfs + ext4 image.
# Needs no loop devices and no mounts. usage: build_guest.sh CACHE
set -euo pipefail

cache=$1
root=$cache/root
modules_wanted="virtio_pci virtio_blk ext4 9p 9pnet_virtio uvcvideo vhci-hcd vivid"
modules_for_boot="virtio_pci virtio_blk ext4"
packages=systemd,systemd-sysv,udev,kmod,dbus,passwd,iproute2,python3,libstdc++6,zlib1g,busybox-static,linux-image-amd64

modules_of() {  # paths below the root of modules and what they need, in the order of loading
    local module
    for module in "$@"; do
        chroot "$root" modprobe --set-version "$version" --show-depends "$module"
    done | awk '$1 == "insmod" && !seen[$2]++ {print $2}'
}

build_tree() {
    rm -rf "$root"
    mmdebstrap --variant=minbase --mode=root --include="$packages" \
        --aptopt='APT::Install-Recommends "false"' \
        --dpkgopt='path-exclude=/usr/share/man/*' \
        --dpkgopt='path-exclude=/usr/share/locale/*' \
        --dpkgopt='path-exclude=/usr/share/doc/*' \
        --dpkgopt='path-include=/usr/share/doc/ptzd/*' \
        bookworm "$root"
    version=$(basename "$root"/lib/modules/*-amd64)
}

keep_only_wanted_modules() {
    local kept=$cache/modules
    rm -rf "$kept"
    modules_of $modules_wanted | while read -r path; do
        install -D -m 644 "$root$path" "$kept$path"
    done
    cp "$root/lib/modules/$version"/modules.{builtin,builtin.modinfo,order} "$kept/lib/modules/$version/"
    rm -rf "$root/lib/modules/$version"
    cp -a "$kept/lib/modules/$version" "$root/lib/modules/"
    chroot "$root" depmod "$version"
}

configure() {
    echo rigvm > "$root/etc/hostname"
    : > "$root/etc/machine-id"
    echo 'LANG=C.UTF-8' > "$root/etc/default/locale"
    printf '%s\n' '/dev/vda / ext4 rw,noatime 0 0' \
        'share /mnt/share 9p trans=virtio,version=9p2000.L,msize=512000,cache=none 0 0' > "$root/etc/fstab"
    mkdir -p "$root/mnt/share"
    cat > "$root/etc/systemd/system/rigtest.service" <<'UNIT'
[Unit]
Description=Runs the test of the shared folder, then leaves the machine with its verdict
RequiresMountsFor=/mnt/share
After=basic.target systemd-udevd.service dbus.socket

[Service]
Type=exec
Environment=HOME=/root PYTHONUNBUFFERED=1
ExecStart=/bin/sh /mnt/share/start.sh
StandardOutput=journal+console

[Install]
WantedBy=multi-user.target
UNIT
    chroot "$root" systemctl --quiet enable rigtest.service
    local unit
    for unit in apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer e2scrub_all.timer fstrim.timer \
        getty@tty1.service proc-sys-fs-binfmt_misc.automount systemd-binfmt.service; do
        ln -sf /dev/null "$root/etc/systemd/system/$unit"
    done
}

build_initramfs() {
    local tree=$cache/initramfs
    rm -rf "$tree"
    mkdir -p "$tree"/{bin,proc,sys,dev,new,modules}
    cp "$root/bin/busybox" "$tree/bin/"
    modules_of $modules_for_boot | while read -r path; do
        cp "$root$path" "$tree/modules/"
        basename "$path" >> "$tree/modules/order"
    done
    cat > "$tree/init" <<'INIT'
#!/bin/busybox sh
b=/bin/busybox
$b mount -t proc proc /proc
$b mount -t sysfs sysfs /sys
$b mount -t devtmpfs devtmpfs /dev
while read -r module; do $b insmod "/modules/$module"; done < /modules/order
tries=0
while [ ! -b /dev/vda ] && [ $tries -lt 100 ]; do $b sleep 0.1; tries=$((tries + 1)); done
$b mount -t ext4 -o rw,noatime /dev/vda /new
$b umount /sys
$b umount /proc
$b mount --move /dev /new/dev
exec $b switch_root /new /lib/systemd/systemd
INIT
    chmod +x "$tree/init"
    (cd "$tree" && find . | cpio --quiet -o -H newc | gzip -1) > "$cache/initramfs.gz"
}

build_image() {
    cp "$root/boot/vmlinuz-$version" "$cache/vmlinuz"
    rm -rf "$root"/boot/* "$root"/var/cache/apt/* "$root"/var/lib/apt/lists/*
    local mebibytes
    mebibytes=$(($(du -sm "$root" | cut -f1) + 2048))
    rm -f "$cache/root.img"
    mke2fs -q -t ext4 -O ^has_journal -m 0 -N 80000 -d "$root" "$cache/root.img" "${mebibytes}M"
}

mkdir -p "$cache"
build_tree
keep_only_wanted_modules
configure
build_initramfs
build_image
rm -rf "$root" "$cache/modules" "$cache/initramfs"
