"""A component file or system.h5 whose content another program changed is refused, and what differs is named."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.model import Configuration, Units
from cmsreduce.pipeline import inspected
from cmsreduce.pipeline.results import check_result, read_limits
from cmsreduce.write import convert, read_component, read_system, verify_seal, write_system
from tests.write.component.test_component_file import chain, written
from tests.write.test_system_file import pendulum

PAGE = Path(__file__).parents[2] / "docs" / "component-file.md"


@pytest.fixture
def path(tmp_path):
    from cmsreduce.orthogonalise import orthogonalise
    from cmsreduce.reduce import CraigBampton

    body = chain()
    modes = orthogonalise(CraigBampton(1e3).reduce(body, body.interface_rows("end")))
    return written(tmp_path / "rotor.h5", modes)


def stiffer(file):
    file["modes/stiffness"][...] *= 4


def renamed(file):
    file.attrs["name"] = "stator"


def relabelled(file):
    file["modes"].attrs["rigid_count"] = 2


def more(file):
    file["modes/extra"] = np.ones(3)


def less(file):
    del file["integrals/rigid_mass_row_sum"]


def unsealed(file):
    del file.attrs["content_sha256"]


def resealed(file):
    file.attrs["content_sha256"] = "0" * 64


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (stiffer, r"changed: modes/stiffness\)"),
        (renamed, r"changed: @name\)"),
        (relabelled, r"changed: modes@rigid_count\)"),
        (more, r"added: modes/extra\)"),
        (less, r"removed: integrals/rigid_mass_row_sum, "),
        (unsealed, "its seal was removed"),
        (resealed, "the seal itself was changed"),
    ],
)
def test_an_edit_is_refused_by_every_reader_and_named(path, edit, says):
    with h5py.File(path, "r+") as file:
        edit(file)
    for use in (
        read_component,
        inspected,
        lambda path: check_result(path, read_limits(None, (), ())),
        lambda path: convert(path, path.with_name("out.op4"), "nastran"),
    ):
        with pytest.raises(ReadError, match=rf"rotor\.h5: .*{says}"):
            use(path)


def test_a_file_of_an_earlier_version_is_read_and_said_to_be_unsealed(path):
    assert read_component(path).sealed
    assert any("sealed: all of its content" in line for line in inspected(path).lines)
    with h5py.File(path, "r+") as file:
        del file.attrs["content_sha256"], file["seal"]
        file.attrs["format_version"] = 2
    assert not read_component(path).sealed
    assert any("not sealed" in line for line in inspected(path).lines)
    (found,) = (each for each in check_result(path, read_limits(None, (), ()))[0] if each.name == "unsealed")
    assert found.passed
    strict, _ = check_result(path, read_limits(None, ("unsealed=0",), ()))
    assert [each.name for each in strict if not each.passed] == ["unsealed"]


@pytest.mark.parametrize("name", ["modes/stiffness", "integrals/rigid_mass", "inputs/B"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused_also_without_a_seal(path, name, bad):
    with h5py.File(path, "r+") as file:
        del file.attrs["content_sha256"], file["seal"]
        file.attrs["format_version"] = 2
        file[name][0, 0] = bad
    with pytest.raises(ReadError, match=f"dataset '{name}' holds a number that is not finite"):
        read_component(path)


def external(file):
    shape = file["modes/mass"].shape
    del file["modes/mass"]
    file.create_dataset("modes/mass", shape, "f8", external=[("other.bin", 0, h5py.h5f.UNLIMITED)])


def linked(file):
    del file["modes/mass"]
    file["modes/mass"] = h5py.ExternalLink("other.h5", "mass")


def soft(file):
    del file["modes/mass"]
    file["modes/mass"] = h5py.SoftLink("/modes/stiffness")


def virtual(file):
    shape = file["modes/mass"].shape
    del file["modes/mass"]
    layout = h5py.VirtualLayout(shape, "f8")
    layout[...] = h5py.VirtualSource("other.h5", "mass", shape)
    file.create_virtual_dataset("modes/mass", layout)


def twice(file):
    del file["modes/mass"]
    file["modes/mass"] = file["modes/stiffness"]


def nested(file):
    file["modes/loop"] = file["modes"]


def hollow(file):
    file.create_dataset("dofs/more", (20_000, 20_000), "f8", chunks=(100, 100), compression="gzip", fillvalue=1.0)


def shrunk(file):
    file.create_dataset("dofs/more", data=np.zeros(2**26), chunks=(2**24,), compression="gzip")


def text(file):
    file["dofs/more"] = "text of any length"


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (external, "'modes/mass' lies in another file"),
        (linked, "'modes/mass' is a link"),
        (soft, "'modes/mass' is a link"),
        (virtual, "'modes/mass' lies in another file"),
        (twice, "is the same object as another item"),
        (nested, "is the same object as another item"),
        (hollow, "'dofs/more' declares 3200000000 bytes, of which not all are stored"),
        (shrunk, r"its datasets declare \d+ bytes, more than a file of \d+ bytes can rightly hold"),
        (text, "'dofs/more' has no values of a fixed size"),
    ],
)
def test_sizes_are_not_believed_and_other_files_stay_closed(path, edit, says):
    with h5py.File(path, "r+") as file:
        del file.attrs["content_sha256"], file["seal"]
        file.attrs["format_version"] = 2
        edit(file)
    with pytest.raises(ReadError, match=rf"rotor\.h5: .*{says}"):
        read_component(path)


@pytest.mark.parametrize("text", [np.bytes_(b"spin"), np.array([[b"spin"]]), np.array([[[1]]]), np.array(3)])
def test_a_text_of_another_shape_or_kind_is_refused(path, tmp_path, text):
    with h5py.File(path, "r+") as file:
        del file["checks/name"]
        file["checks/name"] = text
    with pytest.raises(ReadError, match=r"rotor\.h5: .*checks/name"):
        read_component(path)
    system = tmp_path / "system.h5"
    write_system(system, [pendulum(configuration=Configuration("spin=0"))], provenance={}, units=Units.parse("mm-t-s"))
    with h5py.File(system, "r+") as file:
        del file.attrs["content_sha256"], file["seal"], file["configuration_0/inputs"]
        file["configuration_0/inputs"] = text
    with pytest.raises(ReadError, match=r"system\.h5: the file is damaged"):
        read_system(system)


def test_the_recipe_on_the_page_gives_the_seal(path, monkeypatch):
    monkeypatch.chdir(path.parent)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    (recipe,) = (block for block in blocks if "sealed = " in block)
    found: dict = {"np": np, "h5py": h5py}
    exec(recipe, found)
    assert found["sealed"]
    with h5py.File(path, "r+") as file:
        file["modes/zeta"][0] += 1e-16
    exec(recipe, found)
    assert not found["sealed"]


def test_a_changed_system_file_is_refused(tmp_path):
    path = tmp_path / "system.h5"
    write_system(path, [pendulum(configuration=Configuration("spin=0"))], provenance={}, units=Units.parse("mm-t-s"))
    assert verify_seal(path)
    with h5py.File(path, "r+") as file:
        file["configuration_0/K"][...] *= 4
    for use in (verify_seal, inspected):
        with pytest.raises(ReadError, match=r"system\.h5: .*changed: configuration_0/K\)"):
            use(path)
