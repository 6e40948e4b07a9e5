"""Run the commands of pages as a reader would: in a fresh environment, made by the lines of the pages.

Usage: python tools/commands.py [PAGE ...] [--wheel FILE]

Every page gets a folder of its own. Its `sh`, `bash` and `console` fences are called there from top to
bottom, its Python fences run, each as a script after those above it, and a YAML fence that begins with
`# NAME.yaml` becomes that file. The environment is that of README's line; what a page installs besides is
laid upon it. A fence is not run when a word after its language says why: `long`, `serve` (it goes on until it
is stopped), `hardware`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SKIPPED = ("long", "serve", "hardware")
#: What a reader has before beginning: an arm, and its dynamics as derived by hand.
DYNAMICS = """from armgpi.paper.arm import PaperArm

arm = PaperArm()


def mass_matrix(q):
    return arm.mass_matrix(q)


def gravity(q):
    return arm.gravity(q)
"""


def call(script: str, cwd: Path, bin_dir: Path) -> subprocess.CompletedProcess[str]:
    """Run lines of a shell with an environment's programs first."""
    # Without PYTHON*: nothing of the calling environment may help. No browser is opened.
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    env |= {"PATH": f"{bin_dir}{os.pathsep}{env['PATH']}", "BROWSER": "true", "MPLBACKEND": "Agg"}
    return subprocess.run(
        ["bash", "-ec", script], cwd=cwd, env=env, capture_output=True, text=True, check=False
    )


def installing(text: str, wheel: Path) -> str:
    """Return commands whose `pip install` of this project takes the wheel."""
    line = r"""pip install (["']?)(?:\.|armgpi)\[([\w,]+)\]\1"""
    pip = f"python -m pip install --quiet --disable-pip-version-check -c {ROOT / 'constraints.txt'}"
    return re.sub(line, rf"{pip} '{wheel}[\2]'", text)


def environment(folder: Path, below: Path | None = None) -> Path:
    """Return the programs of a new environment, laid upon another one where there is one."""
    venv.create(folder, with_pip=True)
    if below is not None:
        (packages,) = folder.glob("lib/python*/site-packages")
        (lower,) = below.parent.glob("lib/python*/site-packages")
        # Not the folder alone: the files *.pth in it count too, of which Pinocchio's wheel has one.
        (packages / "below.pth").write_text(
            f"import site; site.addsitedir({str(lower)!r})\n", encoding="utf-8"
        )
        for program in below.iterdir():
            own = folder / "bin" / program.name
            content = program.read_bytes() if program.is_file() else b""
            if not own.exists() and content.startswith(b"#!"):
                own.write_bytes(content.replace(bytes(below), bytes(folder / "bin"), 1))
                own.chmod(0o755)
    return folder / "bin"


def steps(page: Path, wheel: Path) -> list[tuple[str, str]]:
    """Return what a page asks for, each with the place where it stands: lines of a shell."""
    found, text, python = [], page.read_text(encoding="utf-8"), ""
    for match in FENCE.finditer(text):
        language, tags, content = match.groups()
        place = f"{page.name}:{text.count(chr(10), 0, match.start(3)) + 1}"
        if any(tag in tags.split() for tag in SKIPPED):
            continue
        if language in ("sh", "bash"):
            found.append((place, installing(content, wheel)))
        elif language == "console":
            lines = re.findall(r"^\$ (.*)$", content.replace("\\\n", " "), re.MULTILINE)
            found.append((place, installing("\n".join(lines), wheel)))
        elif language == "python":
            python += content
            found.append((place, f"cat > page.py <<'END_OF_PAGE'\n{python}\nEND_OF_PAGE\npython page.py"))
        elif language == "yaml" and (name := re.match(r"# (\S+\.yaml)\n", content)):
            found.append((place, f"cat > {name[1]} <<'END_OF_PAGE'\n{content}END_OF_PAGE"))
    return found


def main() -> None:
    """Make README's environment, then run every page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "pages", nargs="*", type=Path, default=[ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))]
    )
    parser.add_argument("--wheel", type=Path, help="built anew when not given")
    asked = parser.parse_args()
    failed = []
    with tempfile.TemporaryDirectory(prefix="armgpi-commands-") as name:
        tmp = Path(name)
        if asked.wheel is None:
            build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp, ROOT]
            subprocess.run(build, check=True, stdout=subprocess.DEVNULL)
            (asked.wheel,) = tmp.glob("*.whl")
        base = environment(tmp / "readme")
        (install,) = re.findall(
            r"^pip install .*$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE
        )[:1]
        print(f"+ {install}", flush=True)
        done = call(installing(install, asked.wheel), tmp, base)
        if done.returncode:
            sys.exit(done.stderr)
        for number, page in enumerate(asked.pages):
            asks = steps(page, asked.wheel)
            more = any("pip install" in script for _, script in asks)
            programs = environment(tmp / f"env{number}", base) if more else base
            cwd = tmp / f"page{number}"
            cwd.mkdir()
            shutil.copy(ROOT / "urdf" / "anthropomorphic3.urdf", cwd / "my_arm.urdf")
            (cwd / "my_dynamics.py").write_text(DYNAMICS, encoding="utf-8")
            for place, script in asks:
                print(f"+ {place}", flush=True)
                done = call(script, cwd, programs)
                if done.returncode:
                    failed.append(place)
                    print(f"{script}\n{done.stdout[-1500:]}{done.stderr[-1500:]}", flush=True)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
