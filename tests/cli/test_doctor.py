from pathlib import Path

import pytest

from ocplanner.cli import doctor, main
from ocplanner.errors import RenderingError


def test_a_working_machine_passes(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "CHECKS", [check for check in doctor.CHECKS if check is not doctor.check_core])
    assert main(["doctor"]) == 0
    printed = capsys.readouterr().out
    assert "rendering" in printed
    assert "FAIL" not in printed


def test_missing_opengl_is_named_with_its_remedy(capsys, monkeypatch):
    def make_env(*_args, **_options):
        raise RenderingError("no working headless OpenGL; on Debian or Ubuntu run: sudo apt-get install libegl1")

    monkeypatch.setattr("ocplanner.envs.environment.make_env", make_env)
    finding = doctor.check_rendering()
    assert finding.fatal
    assert "apt-get install libegl1" in (finding.remedy or "")
    monkeypatch.setattr(doctor, "CHECKS", (lambda: finding,))
    assert main(["doctor"]) == 2
    assert "apt-get" in capsys.readouterr().out


@pytest.mark.parametrize(("flags", "slow"), [("fpu avx2 fma avx512f", False), ("fpu sse4_2", True)])
def test_processor_features(tmp_path: Path, flags: str, slow: bool):
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text(f"processor : 0\nflags : {flags}\n")
    assert (doctor.check_processor(cpuinfo).remedy is not None) == slow


def test_little_disk_is_a_note(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(doctor, "_NEEDED_FREE_GB", 1e9)
    finding = doctor.check_disk(tmp_path)
    assert finding.remedy is not None
    assert not finding.fatal


def test_unwritable_cache_is_a_note(monkeypatch):
    monkeypatch.setattr(doctor.os, "access", lambda *_: False)
    assert "XDG_CACHE_HOME" in (doctor.check_cache().remedy or "")
