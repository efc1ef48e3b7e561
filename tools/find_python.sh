#!/bin/sh
# Print the path of the first Python that can build the environment, or say in one line what is missing.
#
#   tools/find_python.sh              search this machine
#   tools/find_python.sh CANDIDATE    judge this interpreter alone
#
# A name on PATH proves little: a version manager's shim exists for versions that are not selected here, and
# some systems ship Python without ensurepip. So each candidate is run before it is believed.
# Shell builtins only: PATH may hold nothing else.

case $0 in
    */*) here=${0%/*} ;;
    *) here=. ;;
esac
# Version managers look for .python-version in the working directory.
[ $# -gt 0 ] || CDPATH='' cd -- "$here/.." || exit 1

# The base interpreter is printed, not an active virtual environment: that may be the .venv about to be replaced.
# Status 3: the right version, but not able to make an environment. Any other failure: not a Python for us.
probe='
import sys
if sys.version_info[:2] not in ((3, 12), (3, 13)):
    sys.exit(1)
try:
    import ensurepip, venv
except ImportError:
    sys.exit(3)
print(getattr(sys, "_base_executable", "") or sys.executable)
'
incomplete=''

try() {
    found=$("$1" -I -c "$probe" 2>/dev/null </dev/null)
    status=$?
    if [ $status -eq 0 ] && [ -x "$found" ]; then
        printf '%s\n' "$found"
        exit 0
    fi
    [ $status -ne 3 ] || incomplete=${incomplete:-$1}
}

if [ $# -gt 0 ]; then
    try "$1"
else
    # Every hit on PATH, not only the first: a shim that fails must not hide the system's own Python.
    for name in python3 python3.13 python3.12 python; do
        rest=$PATH:
        while [ -n "$rest" ]; do
            dir=${rest%%:*}
            rest=${rest#*:}
            [ -x "${dir:-.}/$name" ] && try "${dir:-.}/$name"
        done
    done
    # Installed by a version manager, but not selected.
    for version in 3.13 3.12; do
        if command -v uv >/dev/null 2>&1; then
            try "$(uv python find "$version" 2>/dev/null </dev/null)"
        fi
        if command -v pyenv >/dev/null 2>&1; then
            for candidate in "$(pyenv root 2>/dev/null </dev/null)/versions/$version".*/bin/python3; do
                try "$candidate"
            done
        fi
    done
fi

if [ -n "$incomplete" ]; then
    missing="$incomplete has no venv and ensurepip modules"
else
    missing='no Python 3.12 or 3.13 found'
fi
echo "find_python: $missing; install Python 3.12 or 3.13 (on Debian or Ubuntu with its python3.x-venv package) and try again." >&2
exit 1
