# Sourced by scripts that need bare Debian systems (minbase and git). Needs root. Uses the mirror and the proxy of
# this machine's apt, and keeps downloads and the bare root in ~/.cache/ktgp_orb/platform.
# shellcheck shell=bash
case ${1:-} in -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0" && exit 0 ;; esac
say() { echo "$(basename "$0"): $*"; }

# prepare_base SUITE: sets cache and base, makes the bare root if there is none, and locks the suite for this run.
prepare_base() {
  local suite=$1 proxy
  [ "$(id -u)" = 0 ] || {
    say "needs root, to make a root file system and a mount namespace: sudo $0 $suite" >&2
    exit 1
  }
  unshare --mount --pid --fork true 2>/dev/null || {
    say "cannot run: this machine does not allow namespaces (unshare is refused)" >&2
    exit 1
  }
  export PATH=/usr/sbin:/usr/bin:/sbin:/bin
  scripts/setup platform || { say "cannot run: see above" >&2; exit 1; }

  cache=${XDG_CACHE_HOME:-$HOME/.cache}/ktgp_orb/platform/$suite
  mkdir -p "$cache/archives" "$cache/logs"
  exec 9>"$cache/lock"
  flock 9

  # Use this machine's mirror of Debian, if it has one, and its proxy; otherwise debootstrap's default mirror.
  mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Label: Debian' \
    2>/dev/null | head -n 1 || true)
  proxy=$(apt-config dump --format '%v%n' Acquire::http::Proxy | head -n 1)
  [ -z "$proxy" ] || export http_proxy=$proxy https_proxy=$proxy

  base=$cache/base
  [ -d "$base" ] || {
    say "making a bare root of $suite"
    rm -rf "$base.partial"
    debootstrap --variant=minbase --include=git,ca-certificates --cache-dir="$cache/archives" \
      "$suite" "$base.partial" ${mirror:+"$mirror"} >"$cache/logs/debootstrap.log" 2>&1 || {
      tail -n 5 "$cache/logs/debootstrap.log"
      say "cannot run: debootstrap could not make a root of $suite" >&2
      exit 1
    }
    mv "$base.partial" "$base"
  }
}

# new_root FOLDER: makes a copy of the bare root.
new_root() {
  rm -rf --one-file-system "$1"
  cp -a --reflink=auto "$base" "$1"
  apt-config dump | grep -E '^Acquire::(https?::|Retries|Check-Valid-Until|Check-Date)' \
    >"$1/etc/apt/apt.conf.d/90of-this-machine" || true
  cp /etc/resolv.conf /etc/hosts "$1/etc/"
  echo force-unsafe-io >"$1/etc/dpkg/dpkg.cfg.d/90throw-away"  # the root is used for one run
}

# run_in_root ROOT [NAME=VALUE ...] COMMAND ...: runs the command with only these variables in its environment. The
# folders of KTGP_ORB_DATA, KTGP_ORB_ORACLE and KTGP_ORB_RQT are mounted there, read-only.
run_in_root() {
  # The new root is mounted on itself, since "ip netns" needs that inside. Processes in the root end with
  # their process namespace, whose first process can only be ended by SIGKILL.
  unshare --mount --pid --fork --kill-child --propagation private bash -c '
    run=$1 archives=$2
    shift 2
    mount --bind "$run" "$run"
    mount -t proc proc "$run/proc"
    mount --rbind /sys "$run/sys"
    mount --rbind /dev "$run/dev"
    mount -t tmpfs tmpfs "$run/run"
    mount --bind "$archives" "$run/var/cache/apt/archives"
    folders=()
    for name in DATA ORACLE RQT; do
      variable=KTGP_ORB_$name
      [ -n "${!variable:-}" ] || continue
      mkdir -p "$run/root/$name"
      mount --bind "${!variable}" "$run/root/$name"
      mount -o remount,bind,ro "$run/root/$name"
      folders+=("$variable=/root/$name")
    done
    exec chroot "$run" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
      HOME=/root "${folders[@]}" ${http_proxy:+"http_proxy=$http_proxy" "https_proxy=$https_proxy"} "$@"
    ' - "$1" "$cache/archives" "${@:2}" &
  inside=$!
  trap 'kill -9 "$inside"' INT TERM EXIT
  local status=0
  wait "$inside" || status=1
  trap - INT TERM EXIT
  return "$status"
}
