"""Resuming a run whose journal states the setting that was chosen for it."""

import json
from pathlib import Path

import pytest

import spherekit as sk
from spherekit.errors import OutputError
from spherekit.runs.run_folder import JOURNAL, WORK, _checksum


def test_a_journal_with_an_unknown_field_of_the_setting_is_refused(tmp_path):
    """The message says that the folder has unfinished work of another run."""

    def stop(done, total):
        raise KeyboardInterrupt

    options = {"samples": 50, "block": 10, "folder": str(tmp_path), "accuracy": {}}
    with pytest.raises(KeyboardInterrupt):
        sk.run("four_bar", "poles:only=41", progress=stop, **options)
    journal = Path(tmp_path, WORK, JOURNAL)
    content = json.loads(journal.read_text())
    content["state"]["identity"]["setting"]["other_field"] = 1
    content["sha256"] = _checksum(content["state"])
    journal.write_text(json.dumps(content))
    with pytest.raises(OutputError, match="unfinished work of a different run"):
        sk.run("four_bar", "poles:only=41", unfinished="resume", **options)
