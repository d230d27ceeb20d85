#!/bin/sh
# Look for what pip cannot install; install it with apt where that is possible, else print the exact command.
set -eu

install() { # packages…
    command="apt-get install -y --no-install-recommends $*"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "installing with apt: $*"
        (apt-get update -qq && DEBIAN_FRONTEND=noninteractive $command -qq) >/dev/null && return 0
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        echo "installing with sudo apt: $*"
        (sudo apt-get update -qq && sudo DEBIAN_FRONTEND=noninteractive $command -qq) >/dev/null && return 0
    fi
    echo "" >&2
    echo "These system packages are missing. Please run, then repeat make:" >&2
    echo "    sudo $command" >&2
    return 1
}

case "$1" in
venv)
    "$2" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
        echo "Pomona needs Python 3.11 or newer; $2 is $("$2" --version). Choose one: make PYTHON=python3.12 …" >&2
        exit 1
    }
    "$2" -c 'import sys; sys.exit(sys.version_info >= (3, 14))' || {
        echo "Pomona needs Python 3.11 to 3.13: OMPL has no wheel for $("$2" --version). Choose one: make PYTHON=python3.13 …" >&2
        exit 1
    }
    "$2" -c 'import ensurepip, venv' 2>/dev/null || install python3-venv
    ;;
egl)
    missing=""
    libraries=$(ldconfig -p 2>/dev/null || /sbin/ldconfig -p)
    for pair in libEGL.so.1=libegl1 libEGL_mesa.so.0=libegl-mesa0 libOpenGL.so.0=libopengl0; do
        echo "$libraries" | grep -q "${pair%%=*}" || missing="$missing ${pair##*=}"
    done
    ls /usr/lib/*/dri/*swrast_dri.so /usr/lib/*/libgallium* /usr/lib/dri/*swrast_dri.so >/dev/null 2>&1 || {
        ls /usr/lib/*/dri/* >/dev/null 2>&1 || missing="$missing libgl1-mesa-dri"
    }
    [ -z "$missing" ] || install $missing
    ;;
tests)
    libraries=$(ldconfig -p 2>/dev/null || /sbin/ldconfig -p)
    missing=""
    echo "$libraries" | grep -q libusb-1.0.so.0 || missing=libusb-1.0-0
    command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null \
        || missing="$missing chromium"
    [ -z "$missing" ] || install $missing || {
        [ -z "${CI:-}" ] || exit 1
        echo "Without them the tests of the dashboard in a browser and of RealSense's frames are left out."
    }
    ;;
esac
