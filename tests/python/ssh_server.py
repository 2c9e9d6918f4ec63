"""A private sshd on loopback, and the configuration of an ssh that knows it."""

import os
import shutil
import socket
import subprocess

SSHD = shutil.which("sshd", path=os.environ.get("PATH", "") + ":/usr/sbin:/usr/local/sbin")
MISSING = "" if SSHD and shutil.which("ssh") else "there is no ssh or no sshd (apt-get install openssh-server)"


class Sshd:
    """`config` is for ssh -F. `environment`: variables of the sessions."""

    def __init__(self, folder, environment=None):
        self.folder, self.config = folder, folder / "config"
        folder.mkdir()
        for name in ("host", "user"):
            words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name]
            subprocess.run(words, check=True)
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port = probe.getsockname()[1]
        if os.getuid() == 0:
            os.makedirs("/run/sshd", exist_ok=True)
        words = " ".join(f"{name}={value}" for name, value in (environment or {}).items())
        (folder / "sshd").write_text(
            f"ListenAddress 127.0.0.1:{self.port}\nHostKey {folder / 'host'}\nPidFile none\nUsePAM no\n"
            f"StrictModes no\n{f'SetEnv {words}' if words else ''}\n"
            f"AuthorizedKeysFile {folder / 'user.pub'}\nPermitRootLogin prohibit-password\n"
        )
        self.config.write_text(
            f"IdentityFile {folder / 'user'}\nIdentitiesOnly yes\nStrictHostKeyChecking no\nBatchMode yes\n"
            f"UserKnownHostsFile {folder / 'known'}\nLogLevel ERROR\n"
        )
        with open(folder / "log", "wb") as log:
            self.process = subprocess.Popen([SSHD, "-D", "-e", "-f", folder / "sshd"], stderr=log)

    def said(self):
        return (self.folder / "log").read_text()

    def close(self):
        self.process.terminate()
        self.process.wait()
