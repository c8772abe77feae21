#!/bin/sh
# Puts an agent on this board: from wheels/ beside this file, without internet, else from the source tree around it.
#   sudo sh install.sh            the agent in /opt/deltaswarm, its user, its folders and its systemd unit
#   sh install.sh --venv FOLDER   the agent in FOLDER, and nothing else
set -eu
umask 022 # the unit's user reads what root installs
unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX PIP_ROOT PIP_USER # they would install elsewhere

fail() {
    echo "install.sh: $*" >&2
    exit 1
}

here=$(cd "$(dirname "$0")" && pwd)
venv=/opt/deltaswarm
whole=yes
case "${1-}" in
"")
    [ "$(id -u)" = 0 ] || fail "only root may write $venv; run: sudo sh $0"
    ;;
--venv)
    [ $# = 2 ] || fail "--venv FOLDER is expected"
    venv=$2
    whole=no
    ;;
*) fail "$1 is not known; nothing or --venv FOLDER is expected" ;;
esac

python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "Python 3.11 or newer is needed"
if [ -d "$here/wheels" ]; then
    [ -f "$here/SHA256SUMS" ] || fail "SHA256SUMS is missing; copy the bundle again"
    (cd "$here" && sha256sum --check --quiet --strict SHA256SUMS) || fail "the bundle is damaged; copy it again"
    for wheel in "$here"/wheels/*; do
        cut -d ' ' -f 3 "$here/SHA256SUMS" | grep -qxF "wheels/$(basename "$wheel")" ||
            fail "$wheel is not listed in SHA256SUMS; copy the bundle again"
    done
fi
python3 -m venv "$venv" || fail "no environment could be made; on Debian: apt install python3-venv"
extras=
for extra in commands:cryptography ros2:pycdr2; do
    for wheel in "$here"/wheels/"${extra#*:}"-*; do
        [ ! -f "$wheel" ] || extras="$extras${extras:+,}${extra%%:*}"
    done
done
agent="deltaswarm-agent${extras:+[$extras]}"
if [ -d "$here/wheels" ]; then
    PIP_CONFIG_FILE=/dev/null "$venv/bin/python" -m pip --isolated install --quiet --disable-pip-version-check \
        --no-index --find-links "$here/wheels" --force-reinstall "$agent" ||
        fail "no wheels for the Python of this board ($(python3 --version)); see $here/wheels"
else
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$here/.."
fi

if [ $whole = yes ]; then
    getent passwd deltaswarm >/dev/null ||
        useradd --system --user-group --home-dir /var/lib/deltaswarm --no-create-home --shell /usr/sbin/nologin deltaswarm
    install -d -m 0750 -o root -g deltaswarm /etc/deltaswarm
    install -m 0644 "$here/example.toml" /etc/deltaswarm/example.toml
    install -m 0644 "$here/deltaswarm-agent@.service" /etc/systemd/system/
    if [ -d /run/systemd/system ]; then
        systemctl daemon-reload
    fi
    chmod -R a+rX "$venv"
    runuser -u deltaswarm -- "$venv/bin/deltaswarm-agent" board --help >/dev/null ||
        fail "$venv/bin/deltaswarm-agent does not start as the user deltaswarm"
else
    "$venv/bin/deltaswarm-agent" board --help >/dev/null || fail "$venv/bin/deltaswarm-agent does not start"
fi
echo "installed: $venv/bin/deltaswarm-agent"
