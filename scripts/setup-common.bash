# Shared by setup and setup-from-source, which source it: not a command.

root=$(readlink -f "${BASH_SOURCE[0]}")
root=${root%/scripts/*}
venv=$root/.venv
python=$venv/bin/python
state=$venv/.setup # what the set-up knows about .venv: see keep_or_clear and install_femsub
log=$venv/setup.log
cd "$root" || exit

say() { echo "femsub set-up: $*" >&2; }
die() { say "$@"; exit 1; }

extra=${1:-figures} # the argument of the script that sources this
grep -q "^$extra = \[" pyproject.toml || die "pyproject.toml has no extra '$extra' (figures, test, dev, docs)"

# logged COMMAND...: its noise goes to the log. run WHAT_FAILED COMMAND...: the same, or the end.
logged() { echo "+ $*" >>"$log"; "$@" >>"$log" 2>&1 </dev/null; }
log_end() { tail -n "$1" "$log" | sed 's/^/  | /' >&2; }
failed() { log_end 15; die "$1 (whole log: $log)"; }
run() { logged "${@:2}" || failed "$1"; }
trap 'exit 130' INT TERM

# One set-up at a time in this folder. What it started holds the lock too, so that after a kill
# the next call waits for, say, an apt-get that is still at work. Programs that import PETSc do not hold it (9>&-):
# Open MPI starts a daemon for them, orted, which may outlive them.
lock() {
    command -v flock >/dev/null || return 0
    exec 9<"$root"
    flock -n 9 || { say "another set-up is at work in this folder; waiting for it"; flock 9; }
}

# Prints the major version of NumPy that the two packages import with; fails if they do not import.
# -I: neither the caller's PYTHONPATH nor packages in the home folder count. A wheel's packages need its own one first.
solvers_numpy() {
    "$python" -I -c 'import contextlib, numpy
with contextlib.suppress(ModuleNotFoundError): import dolfinx_solver
from petsc4py import PETSc; from slepc4py import SLEPc
print(numpy.__version__.split(".")[0])' 9>&-
}

# True if everything is there, as this pyproject.toml wants it: see install_femsub.
complete() { cmp -s pyproject.toml "$state/$extra" && [ ! -e "$state/pip-unfinished" ]; }

# The end for an account that may not write here.
need_rights() {
    local place=$root
    [ ! -d "$state" ] || place=$state
    [ -w "$place" ] || die "you may not write in $place: its owner, $(stat -c %U "$place"), can run scripts/setup $extra there," \
        "or set up a copy of your own: cp -rT $(printf %q "$root") ~/femsub && chmod -R u+w ~/femsub &&" \
        "~/femsub/scripts/setup $extra"
}

# NumPy as the set-up installed it, where some pip has brought another major version.
numpy_again() {
    [ -s "$state/constraints" ] && [ -w "$state" ] || return
    say "putting $(<"$state/constraints") back, which petsc4py was compiled for"
    logged "$python" -m pip install --disable-pip-version-check -r "$state/constraints" && solvers_numpy >/dev/null 2>&1
}

# True if .venv can stay as it is. Otherwise leaves an empty one, but removes none that is somebody else's.
keep_or_clear() {
    local made_in=$root
    [ ! -e "$state/root" ] || made_in=$(<"$state/root")
    if [ "$made_in" = "$root" ] && { solvers_numpy >/dev/null 2>&1 || numpy_again; }; then
        complete || need_rights
        mkdir -p "$state"
        return
    fi
    need_rights
    [ ! -L "$venv" ] || die "$venv is a link to $(readlink -f "$venv"), which belongs to another folder: remove the link," \
        "or name that environment's interpreter in FEMSUB_PYTHON"
    if [ -d "$state" ]; then
        [ ! -e "$venv/pyvenv.cfg" ] || say "the .venv here is unfinished, broken or was moved: making it anew"
        rm -f "$venv/pyvenv.cfg" # first, so that an interrupted removal never looks like somebody else's
        rm -rf "$venv"
    elif [ -e "$venv/pyvenv.cfg" ]; then
        die "$venv was not made by this script and cannot import petsc4py and slepc4py:" \
            "move it away, or name an interpreter that can in FEMSUB_PYTHON"
    fi
    mkdir -p "$state"
    : >"$log"
    return 1
}

# Prints those of the named Debian packages that are not installed.
lacking() {
    local package
    for package; do
        [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || echo "$package"
    done
}

# need_packages TIME PACKAGE...: installs those of Debian's packages that are missing.
# Status 2 if they are not to be had here.
need_packages() {
    local time=$1 missing package apt sudo=()
    mapfile -t missing < <(lacking "${@:2}")
    [ ${#missing[@]} -gt 0 ] || return 0
    command -v apt-get >/dev/null || { say "this machine has no apt-get"; return 2; }

    local by_hand="apt-get update && apt-get install -y --no-install-recommends ${missing[*]}"
    say "Debian's ${missing[*]} are missing on this machine: apt-get installs them as root ($time)"
    if [ "$(id -u)" != 0 ]; then
        sudo true 2>>"$log" </dev/null || # may ask for a password, on the terminal itself
            die "Debian packages are missing, and you are not root and cannot use sudo." \
                "An administrator must run: $by_hand"
        sudo=(sudo)
    fi
    apt=("${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -y -o DPkg::Lock::Timeout=300)

    known() { for package in "${missing[@]}"; do apt-cache show "$package" >/dev/null 2>&1 || return; done; }
    if ! known; then
        say "fetching apt's lists of packages (about 10 s)"
        logged "${apt[@]}" update || true # one bad source among several is no harm
        known || {
            log_end 5
            say "apt does not know the package $package, or could not fetch its lists (see above)"
            return 2
        }
    fi
    logged "${apt[@]}" install --no-install-recommends "${missing[@]}" && return
    # An interrupted installation is the administrator's to repair. Else the lists are old, most often.
    ! tail -n 5 "$log" | grep -q "dpkg --configure -a" || by_hand="dpkg --configure -a && $by_hand"
    say "that failed; once more with fresh lists (about 30 s)"
    logged "${apt[@]}" update || true
    run "apt-get could not install the packages. An administrator can try: $by_hand" \
        "${apt[@]}" install --no-install-recommends "${missing[@]}"
}

# Installs this package, editable, with what the extra needs. The stamp, a copy of pyproject.toml, is
# written last; scripts/femsub and scripts/test compare it, and look whether pip is, or was stopped, at work.
install_femsub() {
    local unfinished=$state/pip-unfinished redo=()
    if complete; then
        say "all is there already"
        return
    fi
    # petsc4py is compiled against one major version of NumPy and breaks with the next
    [ -s "$state/constraints" ] || echo "numpy==$(solvers_numpy 2>>"$log").*" >"$state/constraints"
    # the same for a pip that somebody calls by hand; a path in this file cannot have blanks
    [[ $state = *[[:space:]]* ]] || printf '[install]\nconstraint = %s\n' "$state/constraints" >"$venv/pip.conf"
    [ ! -e "$unfinished" ] || redo=(--force-reinstall) # a package half written may look complete to pip
    say "installing femsub and its Python packages, extra '$extra' (about 30 s)"
    echo "$extra" >>"$unfinished"
    logged "$python" -m pip install --disable-pip-version-check -c "$state/constraints" "${redo[@]}" \
        -e ".[$(sort -u "$unfinished" | paste -sd,)]" || {
        [ ${#redo[@]} -gt 0 ] || rm "$unfinished" # when pip fails by itself it leaves things as they were
        failed "pip could not install femsub with the extra '$extra'"
    }
    # the commands in scripts/ import benchmarks/ as well, which is not installed
    echo "$root" >"$(echo "$venv"/lib/python3*/site-packages)/femsub-root.pth"
    run "petsc4py and slepc4py do not import in $venv" \
        "$python" -c 'from femsub.algebra.petsc import versions; print(versions())' 9>&-
    echo "$root" >"$state/root"
    local one # the extras whose packages are all in this one
    for one in $("$python" -I -c 'import sys, tomllib
extras = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]
print(*(name for name, needs in extras.items() if set(needs) <= set(extras[sys.argv[1]])))' "$extra"); do
        cp pyproject.toml "$state/$one.new" && mv "$state/$one.new" "$state/$one"
    done
    rm "$unfinished"
    say "done"
}
