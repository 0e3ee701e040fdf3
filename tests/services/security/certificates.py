"""An authority that signs certificates, as SECURITY.md says how: by the openssl program."""

import subprocess
from pathlib import Path


class Authority:
    """Makes `ca.pem` in a folder, and certificates whose common name is a role."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._openssl(
            "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "30",
            "-subj", "/CN=sfid authority", "-keyout", "ca.key", "-out", "ca.pem",
            "-addext", "basicConstraints=critical,CA:TRUE", "-addext", "keyUsage=critical,keyCertSign",
        )  # fmt: skip

    def sign(self, folder: Path, role: str) -> None:
        """Write the certificate and the key of a role, good for this machine's loopback.

        Only a router's is good to be connected to.
        """
        use = "serverAuth,clientAuth" if role in {"router", "edge"} else "clientAuth"
        extensions = folder / f"{role}.ext"
        extensions.write_text(
            "basicConstraints=critical,CA:FALSE\n"
            "keyUsage=critical,digitalSignature\n"
            f"extendedKeyUsage={use}\n"
            f"subjectAltName=IP:127.0.0.1,DNS:localhost,DNS:{role}\n"
        )
        self._openssl(
            "req", "-new", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
            "-subj", f"/CN={role}", "-keyout", f"{role}.key", "-out", f"{role}.csr",
        )  # fmt: skip
        self._openssl(
            "x509", "-req", "-in", f"{role}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial",
            "-days", "30", "-extfile", f"{role}.ext", "-out", f"{role}.pem",
        )  # fmt: skip
        (folder / f"{role}.key").chmod(0o600)

    def _openssl(self, *arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=self._folder, check=True, capture_output=True)
