#!/usr/bin/env bash
# The rig in a virtual machine: the built package under a real systemd with a real video driver, without hardware.
# Builds guest and package when their sources changed, boots, and ends with the guest's verdict (125: it gave none).
# usage: rig_vm.sh [reader|service|all] [SOAK_SECONDS]      needs qemu-system-x86 mmdebstrap cpio and what the package builds with
set -euo pipefail
cd "$(dirname "$0")/../.."

suite=${1:-all}
soak_s=${2:-20}
cache=${PTZD_RIGVM_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/ptzd-rigvm}
here=tests/rigvm
limit_s=$((5400 + soak_s))

need_packages() {
    local missing=() package
    for package in qemu-system-x86 mmdebstrap cpio debhelper python3-venv python3-pip; do
        dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ "${#missing[@]}" -eq 0 ] && return
    export DEBIAN_FRONTEND=noninteractive
    apt-get update --quiet=2
    apt-get install --quiet=2 --yes --no-install-recommends "${missing[@]}" > /dev/null
}

build_guest_if_changed() {
    local key
    key=$(sha256sum "$here/build_guest.sh" | cut -c1-16)
    [ "$(cat "$cache/key" 2>/dev/null)" = "$key" ] && return
    mkdir -p "$cache"
    echo "building the guest ..."
    "$here/build_guest.sh" "$cache" > "$cache/build.log" 2>&1 || { tail -n 30 "$cache/build.log" >&2; exit 125; }
    echo "$key" > "$cache/key"
}

build_package_if_changed() {
    local key
    key=$(git rev-parse HEAD:ptzd HEAD:debian HEAD:packaging HEAD:systemd HEAD:config HEAD:pyproject.toml HEAD:setup.py)
    if [ "$(cat build/deb/key 2>/dev/null)" != "$key" ]; then
        echo "building the package ..."
        packaging/deb.sh
        echo "$key" > build/deb/key
    fi
}

# The processor has SSE4.2 and no AVX: with it, emulated by QEMU 7.2, matrix products of the linear algebra library crash.
boot() {
    timeout --kill-after=5 "$limit_s" qemu-system-x86_64 \
        -accel tcg,thread=multi,tb-size=1024 -machine q35 -cpu Nehalem -smp 2 -m 3072 \
        -nodefaults -nographic -no-reboot -nic none -serial "file:$share/console.txt" -object rng-random,id=rng \
        -device virtio-rng-pci,rng=rng \
        -drive "file=$cache/root.img,format=raw,if=virtio,snapshot=on" \
        -fsdev "local,id=share,path=$share,security_model=none" -device virtio-9p-pci,fsdev=share,mount_tag=share \
        -kernel "$cache/vmlinuz" -initrd "$cache/initramfs.gz" \
        -append "console=ttyS0 root=/dev/vda quiet mitigations=off nokaslr no_timer_check panic=-1 systemd.show_status=0" < /dev/null
}

need_packages
build_guest_if_changed
build_package_if_changed

share=$(mktemp -d)
trap 'rm -rf "$share"' EXIT
cp -r "$here"/guest/* systemd config build/deb/ptzd_*.deb "$share/"
echo "$suite $soak_s" > "$share/arguments"
: > "$share/out.txt"
tail --follow "$share/out.txt" & follow=$!
boot || echo "the machine ended with $?" >&2
sleep 1
kill "$follow"
if [ ! -s "$share/verdict" ]; then
    echo "the guest gave no verdict; the end of its console:" >&2
    tail -n 40 "$share/console.txt" >&2
    exit 125
fi
exit "$(cat "$share/verdict")"
