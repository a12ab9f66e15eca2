"""Wrong content of a `meta.yml` is quoted in one line, however long it is."""

from pathlib import Path

import pytest

from hand_recon.data.dexycb.files import SERIALS, read_intrinsics


def test_a_yaml_list_of_aliases_is_not_written_out(tmp_path: Path) -> None:
    """YAML aliases of fifteen levels: a hundred thousand entries in 400 bytes."""
    levels = ["- &a0 [1, 1]", *(f"- &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 15))]
    path = tmp_path / "calibration" / "intrinsics" / f"{SERIALS[0]}_640x480.yml"
    path.parent.mkdir(parents=True)
    path.write_text("\n".join(levels))
    with pytest.raises(
        ValueError, match=r"holds \[\[1, 1\], .*expected names and values"
    ) as raised:
        read_intrinsics(tmp_path)
    assert len(str(raised.value)) < 600
