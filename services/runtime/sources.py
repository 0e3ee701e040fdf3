"""The digest of the pure core's sources: what kept machine code and kept results belong to."""

from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import sfid_core
from sfid_core.compiled import compiler_available


@cache
def core_digest() -> str:
    """Return the hex SHA-256 of every source file of `sfid_core`, and the versions of numpy and numba."""
    root = Path(sfid_core.__file__).parent
    digest = sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    for package in ("numpy", "numba"):
        try:
            digest.update(f"{package} {version(package)}".encode())
        except PackageNotFoundError:
            digest.update(f"no {package}".encode())
    return digest.hexdigest()


def keep_machine_code(directory: Path) -> bool:
    """Keep what is compiled in a folder of `directory` named after the sources it was compiled from.

    Return whether nothing has been kept there yet. Without numba there is nothing to keep; where
    NUMBA_CACHE_DIR names a folder, that one is used.
    """
    if compiler_available():
        import numba  # noqa: PLC0415 - half a second to load, and optional

        if getattr(numba.config, "CACHE_DIR", ""):
            return False
        kept = directory / f"kernels-{core_digest()[:16]}"
        fresh = not kept.exists()
        kept.mkdir(parents=True, exist_ok=True)
        setattr(numba.config, "CACHE_DIR", str(kept))  # noqa: B010 - its settings are made at run time
        return fresh
    return False
