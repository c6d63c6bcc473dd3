"""System packages: `python3 tools/system.py boards|test|slow` installs what is missing with apt as root, or says it."""

import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

#: libFuzzer's library, which clang's package only recommends
FUZZER = "/usr/lib/llvm-14/lib/clang/14.0.6/lib/linux/libclang_rt.fuzzer-x86_64.a"
#: PortAudio, which sounddevice brings on other systems
PORTAUDIO = "/usr/lib/x86_64-linux-gnu/libportaudio.so.2"
#: command (or file) -> Debian package, by purpose. The one list of what comes from the system.
SYSTEM_PACKAGES = {
    "boards": {"arm-none-eabi-gcc": "gcc-arm-none-eabi", "qemu-system-arm": "qemu-system-arm"},
    "fuzzing": {"clang": "clang", FUZZER: "libclang-rt-14-dev"},
    "browser": {"chromium": "chromium"},
    "aarch64": {
        "aarch64-linux-gnu-gcc": "gcc-aarch64-linux-gnu",
        "/usr/aarch64-linux-gnu/lib/libc.a": "libc6-dev-arm64-cross",
        "qemu-aarch64": "qemu-user",
    },
    "sound": {"jackd": "jackd2", PORTAUDIO: "libportaudio2"},
}
PURPOSES = {"boards": ("boards",), "test": ("boards", "fuzzing", "browser"), "slow": ("aarch64", "sound")}


def there(command):
    """Whether a command is on the path, or a file where it should be."""
    return Path(command).exists() if command.startswith("/") else shutil.which(command) is not None


def missing(purpose):
    """Return the Debian packages whose commands are not to be found."""
    wanted = {command: package for part in PURPOSES[purpose] for command, package in SYSTEM_PACKAGES[part].items()}
    return sorted({package for command, package in wanted.items() if not there(command)})


def install(packages):
    """Install with apt, quietly; raises CalledProcessError."""
    env = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    for command in (["update"], ["install", "-y", "--no-install-recommends", *packages]):
        done = subprocess.run(
            ["apt-get", "-qq", *command],
            env=env,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        if done.returncode != 0 and command != ["update"]:
            sys.stderr.write(done.stdout)
            sys.exit("apt-get could not install %s (its words are above)" % " ".join(packages))


def main():
    """Install what is missing, one run at a time."""
    purpose = sys.argv[1] if len(sys.argv) == 2 else ""
    if purpose not in PURPOSES:
        sys.exit("usage: python3 tools/system.py boards|test|slow")
    if not missing(purpose):
        return
    folder = Path(__file__).resolve().parent.parent / ".setup"
    folder.mkdir(exist_ok=True)
    with open(folder / "lock", "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        packages = missing(purpose)
        if not packages:
            return
        if os.geteuid() != 0 or shutil.which("apt-get") is None:
            sys.exit("needed from the system: apt-get install %s" % " ".join(packages))
        print("install: apt-get install %s" % " ".join(packages), file=sys.stderr, flush=True)
        install(packages)
    if missing(purpose):
        sys.exit("installed, and still not to be found: %s" % " ".join(missing(purpose)))


if __name__ == "__main__":
    main()
