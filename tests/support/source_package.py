"""Debian's source packages: fetched with apt-get from the mirror that this machine uses, with lists of their own."""

import pathlib
import re
import shutil
import subprocess
import tarfile
import tempfile


class Missing(Exception):
    """What this machine would need."""


def apt_sources(folder):
    """A sources list like this machine's, but of source packages."""
    text = ""
    for path in sorted(pathlib.Path("/etc/apt/sources.list.d").glob("*.sources")):
        for stanza in re.split(r"\n\s*\n", path.read_text(encoding="utf-8", errors="replace")):
            if re.search(r"^Types:.*\bdeb\b", stanza, re.M) and "debian" in stanza:
                text += re.sub(r"^Types:.*$", "Types: deb-src", stanza, flags=re.M) + "\n\n"
    found = [("sources", text)] if text else []
    lines = [re.sub(r"^deb\s", "deb-src ", line) for path in
             [pathlib.Path("/etc/apt/sources.list"), *pathlib.Path("/etc/apt/sources.list.d").glob("*.list")]
             if path.exists() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()
             if re.match(r"deb\s.*debian", line)]
    if lines:
        found.append(("list", "\n".join(lines) + "\n"))
    if not found:
        raise Missing("a Debian mirror in /etc/apt")
    for kind, text in found:
        (folder / f"porttape.{kind}").write_text(text, encoding="utf-8")


def download(package, folder):
    """The package's files, in that folder. No root, and /etc untouched."""
    (folder / "lists" / "partial").mkdir(parents=True)
    (folder / "parts").mkdir()
    apt_sources(folder / "parts")
    options = ["-qq", "-o", "Dir::Etc::sourcelist=/dev/null", "-o", f"Dir::Etc::sourceparts={folder}/parts",
               "-o", f"Dir::State::lists={folder}/lists", "-o", f"Dir::Cache={folder}/cache", "-o", "APT::Sandbox::User="]
    # The upstream tarball is enough: Debian changes no test.
    for verb in (["update"], ["source", "--tar-only", "--download-only", package]):
        done = subprocess.run(["apt-get", *options, *verb], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Missing(f"{package}'s sources; apt-get {verb[0]} said: {done.stderr.strip()}")


def fetch(package, path, cache):
    """That path (a folder or file) in the package's upstream sources; fetched once, into the folder `cache`."""
    kept = cache / package
    found = sorted(kept.glob(f"{package}-*/{path}"))
    if found:
        return found[0]
    if not shutil.which("apt-get"):
        raise Missing("apt-get")
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="fetch-", dir=kept) as name:
        folder = pathlib.Path(name)
        download(package, folder)
        with tarfile.open(next(folder.glob(f"{package}_*.orig.tar.*"))) as tar:
            tar.extractall(folder, filter="data") if hasattr(tarfile, "data_filter") else tar.extractall(folder)
        top = next((top for top in folder.glob(f"{package}-*/") if (top / path).exists()), None)
        if top is None:
            raise Missing(f"{path} in {package}'s sources")
        top.rename(kept / top.name)
    return kept / top.name / path
