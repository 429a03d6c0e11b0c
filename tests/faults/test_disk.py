"""An error of the disk names the file that was to be written."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from slipctl.run import store
from slipctl.study.files import results_folder

pytestmark = pytest.mark.second


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left") as error:
        store.write_with(tmp_path / "report.html", full)
    assert error.value.filename == str(tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "said", [OSError(errno.ENOSPC, "No space"), RuntimeError("NetCDF: HDF error")]
)
def test_a_log_on_a_full_disk_names_the_file(said, tmp_path: Path, monkeypatch) -> None:
    """netCDF says neither the file nor the reason."""
    import xarray

    def fails(*_: object, **__: object) -> None:
        raise said

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", fails)
    data = xarray.Dataset({"v": ("time", [1.0, 2.0])}, coords={"time": [0.0, 1.0]})
    data["v"].attrs["units"] = "m/s"
    with pytest.raises(OSError, match=r"No space|HDF error") as error:
        results_folder.draft_log(data, tmp_path / "logs", "sta")
    assert error.value.filename == str(tmp_path / "logs" / "sta.nc")
    assert not list((tmp_path / "logs").iterdir())
