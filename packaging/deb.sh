#!/usr/bin/env bash
# Build the Debian package of the last commit, in build/deb; print its path.
set -euo pipefail
cd "$(dirname "$0")/.."

version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' ptzd/__init__.py)
tree=build/deb/ptzd-$version
rm -rf build/deb
mkdir -p "$tree"
git archive HEAD | tar --extract --directory="$tree"
git describe --always --exclude='*' --abbrev=12 HEAD > "$tree/ptzd/commit.txt"
git diff --quiet HEAD || echo "changes that are not committed are not in the package" >&2

export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
cat > "$tree/debian/changelog" <<CHANGELOG
ptzd ($version) stable; urgency=medium

  * See CHANGELOG.md.

 -- The ptzd developers <ptzd@localhost>  $(date --utc --rfc-email --date="@$SOURCE_DATE_EPOCH")
CHANGELOG

(cd "$tree" && dpkg-buildpackage --build=binary --no-sign) > build/deb/build.log 2>&1 || {
    tail -n 40 build/deb/build.log >&2
    exit 1
}
ls "$PWD"/build/deb/ptzd_*.deb
