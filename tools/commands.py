"""Run the commands of pages as a reader would: in fresh environments, made by the lines of the pages.

Usage: python tools/commands.py [PAGE ...] [--wheel FILE]

Every page and notebook gets a folder of its own, a clone where it calls make or files of one. Its `sh`,
`bash` and `console` fences are called there from top to bottom, its Python runs as one script between them,
and a YAML fence that begins with `# NAME.yaml` becomes that file. The environment is that of README's line
with the extras that the page's prose names; where a page or notebook begins with a `pip install` of its own,
that alone (and IPython for a notebook). A fence is not run when a word after its language says why: `long`
(minutes), `serve` (it goes on until it is stopped), `hardware`, `yours` (a file that only
the reader has). One with `fails` has to end with code 1.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALL = re.compile(r"""pip install (["']?)(?:\.|armgpi)\[([\w,]+)\]\1""")
PIP_LINE = re.compile(r"^pip install .*$", re.MULTILINE)
SKIPPED = ("long", "serve", "hardware", "yours")
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
    # Python compiles the modules that a page imports by itself, a fraction of all.
    pip = "python -m pip install --quiet --disable-pip-version-check --no-compile"
    text = text.replace("pip install", f"{pip} -c {ROOT / 'constraints.txt'}")
    return re.sub(r"""(["']?)(?:\.|armgpi)\[([\w,]+)\]\1""", rf"'{wheel}[\2]'", text)


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


def read(page: Path) -> str:
    """Return the text of a page; of a notebook its prose, and its code as Python fences."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
    # What is shown at a cell's end is displayed as a notebook does.
    shell = "from IPython.core.interactiveshell import InteractiveShell as S\n"
    each = [f"S.instance().run_cell({code!r}).raise_error()" for kind, code in cells if kind == "code"]
    prose = "\n\n".join(code for kind, code in cells if kind != "code")
    return "\n".join([prose, "```python", shell, *each, "```", ""])


def shell(content: str, tags: str) -> str:
    """Return lines of a shell that succeed where the page says what they end with."""
    return f"{{\n{content}}} && exit 9 || [ $? -eq 1 ]\n" if "fails" in tags.split() else content


def steps(page: Path, text: str, wheel: Path) -> list[tuple[str, str]]:
    """Return what a page asks for, each with the place where it stands: lines of a shell."""
    found: list[tuple[str, str]] = []
    lines, waits = [""] * text.count("\n"), ""  # Python at its lines in the page

    def ask(place: str, script: str) -> None:
        nonlocal waits
        if waits:
            code = "\n".join(lines)
            found.append((waits, f"cat > page.py <<'END_OF_PAGE'\n{code}\nEND_OF_PAGE\npython page.py"))
            waits = ""
        if script:
            found.append((place, installing(script, wheel)))

    for match in FENCE.finditer(text):
        language, tags, content = match.groups()
        first = text.count("\n", 0, match.start(3))
        place = f"{page.name}:{first + 1}"
        if any(tag in tags.split() for tag in SKIPPED):
            continue
        if language in ("sh", "bash"):
            ask(place, shell(content, tags))
        elif language == "console":
            ask(place, "\n".join(re.findall(r"^\$ (.*)$", content.replace("\\\n", " "), re.MULTILINE)))
        elif language == "python":
            lines[first : first + content.count("\n")] = content.splitlines()
            waits = waits or place
        elif language == "yaml" and (name := re.match(r"# (\S+\.yaml)\n", content)):
            ask(place, f"cat > {name[1]} <<'END_OF_PAGE'\n{content}END_OF_PAGE")
    ask("", "")
    return found


class Environments:
    """The environments that lines of pages make, each made once."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.folder, self.wheel = folder, wheel
        self._programs: dict[str, Path] = {}
        self.readme = self.installed(PIP_LINE.findall(read(ROOT / "README.md"))[0])

    def installed(self, line: str, below: Path | None = None) -> Path:
        """Return the programs of the environment that a line makes."""
        if line not in self._programs:
            print(f"+ {line}", flush=True)
            programs = environment(self.folder / f"env{len(self._programs)}", below)
            done = call(installing(line, self.wheel), self.folder, programs)
            if done.returncode:
                sys.exit(done.stderr)
            self._programs[line] = programs
        return self._programs[line]

    def of(self, page: Path, text: str) -> Path:
        """Return the programs that a page asks for."""
        extras = sorted({f"armgpi[{names}]" for _, names in INSTALL.findall(text)})
        if page.suffix == ".ipynb":
            return self.installed(" ".join(["pip install", *extras, "ipython"]))
        if page.name != "README.md" and (own := PIP_LINE.findall(text)):
            return self.installed(own[0])
        return self.installed(" ".join(["pip install", *extras]), self.readme) if extras else self.readme


def run(page: Path, environments: Environments, cwd: Path) -> list[str]:
    """Run a page in a folder and return the places that failed."""
    text = read(page)
    asks = steps(page, text, environments.wheel)
    programs = environments.of(page, text)
    if any(re.search(r"^make |\bexamples/|\btools/", script, re.MULTILINE) for _, script in asks):
        subprocess.run(["git", "clone", "--quiet", ROOT, cwd], check=True)
    cwd.mkdir(exist_ok=True)
    shutil.copy(ROOT / "urdf" / "anthropomorphic3.urdf", cwd / "my_arm.urdf")
    (cwd / "my_dynamics.py").write_text(DYNAMICS, encoding="utf-8")
    failed = []
    for place, script in asks:
        began = time.monotonic()
        done = call(script, cwd, programs)
        print(f"+ {place} ({time.monotonic() - began:.0f} s)", flush=True)
        if done.returncode:
            failed.append(place)
            print(f"{script[-1500:]}\n{done.stdout[-1500:]}{done.stderr[-1500:]}", flush=True)
    return failed


def main() -> None:
    """Run the pages that are asked for, or all."""
    every = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("examples/notebooks/*.ipynb")]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pages", nargs="*", type=Path, default=every)
    parser.add_argument("--wheel", type=Path, help="built anew when not given")
    asked = parser.parse_args()
    failed: list[str] = []
    with tempfile.TemporaryDirectory(prefix="armgpi-commands-") as name:
        tmp = Path(name)
        if asked.wheel is None:
            build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp, ROOT]
            subprocess.run(build, check=True, stdout=subprocess.DEVNULL)
            (asked.wheel,) = tmp.glob("*.whl")
        environments = Environments(tmp, asked.wheel)
        for number, page in enumerate(sorted(asked.pages)):
            failed += run(page, environments, tmp / f"page{number}")
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
