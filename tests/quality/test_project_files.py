# SPDX-License-Identifier: MIT
"""Files for the services around the repository: schemas, the commands of the workflow, the hooks.
The schemas are those of check-jsonschema, so no network is needed.
"""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import ROOT
from programs import call, run

WORKFLOW = ROOT / ".github/workflows/ci.yml"
SCHEMAS = {  # the file, its schemas, a line that breaks it
    ".github/workflows/ci.yml": ("vendor.github-workflows", "    runs-on: ubuntu-24.04\n"),
    ".github/ISSUE_TEMPLATE/bug.yml": ("vendor.github-issue-forms", "name: Something is wrong\n"),
    "CITATION.cff": ("vendor.citation-file-format", "title: dahl\n"),
}


def schema_accepts(schema: str, file: Path) -> bool:
    words = ["-m", "check_jsonschema", "--builtin-schema", schema, file]
    return call(sys.executable, *words).returncode == 0


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_file_follows_its_schema(name: str, tmp_path: Path) -> None:
    schema, needed = SCHEMAS[name]
    assert schema_accepts(schema, ROOT / name)
    (broken := tmp_path / Path(name).name).write_text(
        (ROOT / name).read_text().replace(needed, "", 1)
    )
    assert not schema_accepts(schema, broken)


def test_an_environment_in_the_checkout_is_no_file_of_it() -> None:
    """docs/python.md creates one there; tools/docs.sh and tools/release.sh must not see it."""
    for folder in ("venv", ".venv"):
        run("git", "-C", ROOT, "check-ignore", f"{folder}/lib64")


def test_each_job_of_the_workflow_has_an_end() -> None:
    assert schema_accepts("custom.github-workflows-require-timeout", WORKFLOW)


def commands() -> set[str]:
    """Return the commands of this project that the workflow runs, with the values of its matrix."""
    found = set()
    for job in yaml.safe_load(WORKFLOW.read_text())["jobs"].values():
        choices = job.get("strategy", {}).get("matrix", {}).get("command", [])
        runs = [step["run"] for step in job["steps"] if "run" in step]
        found |= {line for line in [*runs, *choices] if line.startswith("tools/")}
    return found


def test_the_workflow_runs_the_two_commands_and_the_release() -> None:
    """Each is a script with these options."""
    words = [shlex.split(line) for line in commands()]
    assert {script for script, *_ in words} == {
        "tools/demo.sh",
        "tools/test.sh",
        "tools/release.sh",
    }
    for script, *options in words:
        usage = run(ROOT / script, "--help")
        assert {one for one in options if one.startswith("-")} <= {*re.findall(r"--[\w-]+", usage)}


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of this checkout in a repository of their own, with its build folder."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in run(
        "git", "ls-files", "--cached", "--others", "--exclude-standard", cwd=ROOT
    ).split("\n"):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    run("git", "init", "--quiet", folder)
    (folder / ".git/info/exclude").write_text("build\n")
    run("git", "add", "--all", cwd=folder)
    (folder / "build").symlink_to(ROOT / "build")
    return folder


def hooks(folder: Path, *words: str) -> Any:
    """Run the hooks as Git does before a commit."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    own["PRE_COMMIT_HOME"] = str(folder / ".git/pre-commit")
    return call(sys.executable, "-m", "pre_commit", "run", *words, cwd=folder, env=own)


def test_the_hook_before_a_commit_has_the_rules_of_the_tests(checkout: Path) -> None:
    done = hooks(checkout, "--all-files")
    assert done.returncode == 0, done.stdout
    (checkout / "tools/unused.py").write_text("import os\n")
    run("git", "add", "tools/unused.py", cwd=checkout)
    done = hooks(checkout)
    assert done.returncode != 0 and "unused-import" in done.stdout and "style" in done.stdout


def test_the_hook_before_a_push_runs_all_static_tests() -> None:
    """It names tests that exist: as many as pytest finds there."""
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    (hook,) = (hook for hook in config["repos"][0]["hooks"] if hook["id"] == "static")
    python, *words = shlex.split(hook["entry"])
    assert python == "build/venv/bin/python" and not {"-k", "--deselect", "--ignore"} & {*words}
    listed = run(sys.executable, *words, "--collect-only", cwd=ROOT)
    assert {path.name for path in (ROOT / "tests/static").glob("test_*.py")} <= {
        Path(line.partition("::")[0]).name for line in listed.splitlines()
    }
