"""Every kind of mistake ends in one error that names file, line, key and remedy."""

import re
from pathlib import Path

import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.config.keys import Keys
from cmsreduce.errors import ConfigError, ReadError

# What is replaced in the pipeline, by what, how many lines off the message stands, and words of it.
MISTAKES = {
    "unknown key": (
        "rank: gregory, keep: {frf", "rank: gregory, keeep: {frf", 0,
        "key 'balance.keeep' is unknown: did you mean 'keep'? Known keys: rank, keep, weighting, scaling, clusters"),
    "key that was removed": (
        "balance: {rank: gregory", "balance: {clusters: {rotate: true}, rank: gregory", 0,
        "key 'balance.clusters.rotate' has been removed. Shapes of a cluster are not rotated any more. Take the key "
        "out: `rank: hankel` weighs the modes of a cluster together"),
    "ranking that was removed": (
        "rank: gregory, keep: {frf", "rank: peak-amplitude, keep: {frf", 0,
        "key 'balance.rank': 'peak-amplitude' is no longer a ranking: write gregory, which gives the same order"),
    "unknown key, deep": (
        "rotor.bdf}", "rotor.bdf, fromat: bulk}", 0,
        "key 'components.rotor.geometry.fromat' is unknown: did you mean 'format'? Known keys: file, format"),
    "key of another mapping": (
        "balance: {", "band: 20 Hz\nbalance: {", 0, "key 'band' is unknown here: it belongs under 'scene'."),
    "missing key": (
        "band: 10 Hz", "units: SI", -1, "key 'scene' lacks 'band', e.g. band: 10 Hz"),
    "mass forgotten": (
        "    mass:      {file: ../sample_models/galileo/rotor.op4, matrix: MAA}\n", "", -2,
        "`stiffness` is given without `mass`"),
    "text for a number": (
        "mass: 120.0", "mass: heavy", 0,
        "key 'components.platform.rigid.mass': found the text 'heavy', expected a number, e.g. 120.0"),
    "truth for a number": ("cutoff: 3.0", "cutoff: true", 0, "key 'reduce.cutoff': found true, expected a number"),
    "list for a mapping": (
        "interfaces: {hinge: {position: [0, 0, 0]}}", "interfaces: [hinge]", 0,
        "key 'components.platform.interfaces': found a list, expected a mapping of names, e.g. {hinge: {node: 1001}}"),
    "infinite number": ("cutoff: 3.0", "cutoff: .inf", 0, "expected a finite number"),
    "number out of range": ("cutoff: 3.0", "cutoff: 0", 0, "found the number 0, expected a number above 0, e.g. 2.0"),
    "two numbers for three": (
        "force: [0, 0, 1]", "force: [0, 1]", 0, "3 numbers are expected, e.g. [0, 0, 1], found 2"),
    "five inertias": ("[10, 12, 8, 0.5, 0, -1]", "[10, 12, 8, 0.5, 0]", 0, "6 numbers are expected, xx yy zz xy xz yz"),
    "impossible inertia": ("[10, 12, 8, 0.5, 0, -1]", "[10, 12, 80, 0, 0, 0]", 0, "no mass distribution has"),
    "misspelt choice": (
        "method: guyan", "method: guyann", 0,
        "found the text 'guyann', did you mean 'guyan'? expected craig-bampton or"),
    "interface cutoff without constraint modes": (
        "method: guyan", "method: macneal-rubin, interface_cutoff: 3", 0,
        "key 'components.rotor.reduce': macneal-rubin has no constraint modes, so interface_cutoff does not apply"),
    "residual that is no dof": (
        "method: guyan", "method: guyan, residuals: [12.q]", 0,
        "key 'components.rotor.reduce.residuals[0]': '12.q' is no residual: write sensors, actuators, dampers, or"),
    "two rules of system modes": (
        "write: {formats: [hdf5]}", "project: {modes: {count: 3, list: [1]}}", 0,
        "project.modes takes one of cutoff, list, count: found list and count"),
    "misspelt tie": (
        "nodes: [7, 8, 9], dofs: 123", "nodes: [7, 8, 9], tie: rigit", 0,
        "key 'components.stator.interfaces.platform_hinge.tie': found the text 'rigit', did you mean 'rigid'?"),
    "tie without nodes": (
        "{nodes: [7, 8, 9], dofs: 123}", "{position: [0, 0, 1], tie: rigid}", 0,
        "key 'components.stator.interfaces.platform_hinge': `tie: rigid` takes one of node, nodes, set"),
    "weights of a set": (
        "{nodes: [7, 8, 9], dofs: 123}", "{set: b, tie: average, weights: [1, 2]}", 0,
        "weights belong to a list of nodes"),
    "weights of a rigid tie": (
        "nodes: [7, 8, 9], dofs: 123", "nodes: [7, 8, 9], tie: rigid, weights: [1, 2, 1]", 0,
        "a rigid tie has no weights"),
    "weights without a tie": ("dofs: 123}", "weights: [1, 2, 1]}", 0, "add `tie: average`"),
    "too few weights": (
        "nodes: [7, 8, 9], dofs: 123", "nodes: [7, 8, 9], tie: average, weights: [1, 2]", 0,
        "3 nodes need as many weights, found 2"),
    "weight of zero": (
        "nodes: [7, 8, 9], dofs: 123", "nodes: [7, 8, 9], tie: average, weights: [1, 0, 1]", 0,
        "found the number 0, expected a number above 0"),
    "dofs of an average": (
        "nodes: [7, 8, 9], dofs: 123", "nodes: [7, 8, 9], dofs: 123, tie: average", 0,
        "an average tie uses the translations of the nodes: take `dofs` out"),
    "tie of a rigid body": (
        "{hinge: {position: [0, 0, 0]}}", "{hinge: {nodes: [1], position: [0, 0, 0], tie: rigid}}", 0,
        "an interface of a rigid body is given by its position"),
    "unknown format": (
        "[hdf5]", "[hdf5, contops]", 0,
        "key 'write.formats[1]': found the text 'contops'; expected hdf5 or matlab or abcd or nastran or"),
    "dialect of a format that has none": (
        "{formats: [hdf5]}", "{formats: [hdf5, mbsim], dialects: {mbsim: lumped}}", 0,
        "key 'write': 'mbsim' has no dialects (those that have: sid, mbdyn, fmi, extptfm)"),
    "dialect of another format": (
        "{formats: [hdf5]}", "{formats: [hdf5, sid], dialects: {sid: lumped}}", 0,
        "key 'write': 'lumped' is no dialect of sid (its dialects: by-axis, by-mode, gr-by-mode, embs)"),
    "dialect of what is not written": (
        "{formats: [hdf5]}", "{formats: [hdf5], dialects: {sid: by-mode}}", 0,
        "key 'write': sid is not written, so its dialect has no effect: add it to the formats"),
    "length for a frequency": (
        "band: 10 Hz", "band: 10 m", 0, "key 'scene.band': 10 m is a length, a frequency is expected, e.g. 10 Hz"),
    "empty band": ("band: 10 Hz", "band: [10, 1 Hz]", 0, "the band from 10 to 1 Hz is empty"),
    "angle without a unit": (
        "[0, 45, 90 deg]", "[0, 45, 90]", 0,
        "key 'scene.articulation.spin': 90 has no unit, an angle is expected: write deg or rad"),
    "angle without a unit among several": ("[0, 45, 90 deg]", "[45, 1 rad, 90 deg]", 0, "write its unit"),
    "length for an angle": ("[0, 30 deg]", "[0, 30 mm]", 0, "30 mm is a length, an angle is expected"),
    "setting twice": ("[0, 45, 90 deg]", "[0, 45, 45 deg]", 0, "45.0 deg is listed twice"),
    "range without steps": ("[0, 45, 90 deg]", "{from: 0, to: 90 deg}", 0, "a range needs from, to and steps"),
    "unknown joint": (
        "{spin: [0, 45", "{spinn: [0, 45", 0,
        "key 'scene.articulation.spinn': there is no joint 'spinn', did you mean 'spin'? There are: spin, cone"),
    "locked dof": (
        "cone: [0, 30 deg]", "cone.rx: [0, 30 deg]", 0,
        "key 'scene.articulation.cone.rx': joint 'cone' is locked in rx, it is free in ry"),
    "locked joint": ("free: [ry]", "free: none", 1, "joint 'cone' is locked in all dofs"),
    "several free dofs": ("free: [ry]", "free: [rx, ry]", 1, "name one, such as cone.rx"),
    "motor on a locked dof": (
        "joint: spin, dof: rz", "joint: spin, dof: rx", 0,
        "key 'scene.actuators.motor.dof': joint 'spin' is locked in rx"),
    "unknown component": (
        "at: platform.cg", "at: platfrom.cg", 0,
        "key 'scene.sensors.gyro.at': there is no component 'platfrom', did you mean 'platform'?"),
    "unknown interface": (
        "stator.platform_hinge, platform", "stator.platform_hing, platform", 0,
        "key 'scene.joints.cone.connect[0]': component 'stator': there is no interface 'platform_hing', did you mean"),
    "node for an interface": (
        "rotor.spin_bearing]", "rotor.1001]", 0,
        "declare the node under 'components.rotor.interfaces', e.g. NAME: {node: 1001}"),
    "node of a rigid body": ("at: platform.cg", "at: platform.12", 0, "points of 'platform' are cg, hinge"),
    "cg of a flexible body": ("at: rotor.1200", "at: rotor.cg", 0, "name a node"),
    "point without a dot": ("at: rotor.1200", "at: rotor", 0, "'rotor' is no point: write COMPONENT.INTERFACE"),
    "unknown component in rows": ("stator.12.ry: -2", "statr.12.ry: -2", 0, "key 'scene.sensors.los.rows.statr.12.ry'"),
    "row without dof": ("stator.12.ry: -2", "stator.12: -2", 0, "write COMPONENT.NODE.DOF, e.g. rotor.1300.rx"),
    "unknown dof": ("free: [rz]", "free: [rzz]", 0, "'rzz' is no dof"),
    "sensor without measure": (", measure: [rx, ry, rz]", "", 0, "needs `measure`"),
    "actuator with two places": (
        "joint: spin, dof: rz", "joint: spin, at: rotor.1", 0, "an actuator takes one of at, joint, between, rows"),
    "negative damping": (
        "modal: 0.005", "modal: -0.005", 0,
        "key 'components.rotor.damping.modal': damping modal: -0.005 is not positive"),
    "no damping": (
        "structural: 0.01", "structural: 0", 0, "key 'components.stator.damping.structural': damping struct"),
    "two laws of damping": ("{modal: 0.005}", "{modal: 0.005, structural: 0.1}", 0, "found modal and structural"),
    "damping of a rigid body": (
        "    interfaces: {hinge", "    damping: {modal: 0.1}\n    interfaces: {hinge", 0,
        "a rigid body has no damping"),
    "rigid interface without position": ("{position: [0, 0, 0]}", "{node: 3}", 0, "is given by its position"),
    "flexible interface by position": ("{node: 1001}", "{position: [0, 0, 1]}", 0, "given by node, nodes, set or near"),
    "position without a distance": ("{node: 1001}", "{near: [0, 0, 1]}", 0, "add `within: 2 mm`"),
    "distance without a position": ("{node: 1001}", "{node: 1001, within: 2 mm}", 0, "add `near: [x, y, z]`"),
    "distance that is no length": ("{node: 1001}", "{near: [0, 0, 1], within: 2 Hz}", 0, "2.0 Hz is no length"),
    "interface named like a node": ("{hinge: {pos", "{12: {pos", 0, "an interface cannot be named '12'"),
    "component named system": ("  platform:\n", "  system:\n", 0, "a component cannot be named 'system'"),
    "name with a dot": ("name: galileo", "name: galileo.2", 0, "'galileo.2' is no name"),
    "unknown unit system": ("units: mm-t-s", "units: mm-stone-s", 0, "unknown mass 'stone'"),
    "unequal axes": (
        "{node: 1001}", "{node: 1001, frame: {axes: [[1, 0, 0], [1, 1, 0], [0, 0, 1]]}}", 0, "not orthonormal"),
    "left-handed axes": (
        "{node: 1001}", "{node: 1001, frame: {axes: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}}", 0, "left-handed"),
    "duplicate key": (
        "balance: {rank", "reduce: {cutoff: 4}\nbalance: {rank", 0, "key 'reduce' is given twice, first in line "),
    "key without a value": (
        "write: {formats: [hdf5]}", "write:", 0,
        "key 'write' has no value: write one after it, e.g. write: {formats: [hdf5]}, or {} to take the defaults, or"),
    "key that must have a value": (
        "band: 10 Hz", "band:", 0, "key 'scene.band' has no value: write one after it, e.g. band: 10 Hz"),
    "word of other programs": (
        "band: 10 Hz", "band: 10 Hz\n  configurations: [1]", 1, "is unknown: did you mean 'articulation'?"),
    "decimal comma": (
        "mass: 120.0", "mass: '1,5'", 0,
        "found the text '1,5', expected a number, which has a point, not a comma: 1.5"),
    "comma before thousands": (
        "mass: 120.0", "mass: '1,200'", 0, "found the text '1,200', expected a number without a unit, e.g. "),
    "decimal comma of a frequency": ("band: 10 Hz", "band: 1,5", 0, "which has a point, not a comma: 1.5"),
    "decimal comma of a whole number": (
        "{node: 1001}", "{node: '1,5'}", 0, "found the text '1,5', expected a whole number without a unit, e.g. 1001"),
    "number in quotes": ("mass: 120.0", "mass: '120'", 0, "expected a number, without quotes: 120"),
    "unit of another kind": ("band: 10 Hz", "band: 10 kg", 0, "'10 kg' is not a frequency, e.g. 10 Hz"),
    "mass of a rigid body outside of it": (
        "    interfaces: {hinge", "    mass: 120.0\n    interfaces: {hinge", 0,
        "found the number 120.0; numbers of a rigid body stand under `rigid`"),
    "a value that may be of two kinds": (
        "write: {formats", "verify: {between: -3}\nwrite: {formats", 0,
        "key 'verify.between': found the number -3; expected all or a number at least 0"),
    "older YAML": ("name: galileo", "%YAML 1.1\n---\nname: galileo", 0, "the file says that it is YAML 1.1, in which"),
    "tag": ("name: galileo", "name: !!python/object:os.system galileo", 0, "has the tag !!python/object:os.system"),
    "memory without unit": (
        "name: galileo", "name: galileo\nsolver: {memory: 8}", 1,
        "key 'solver.memory': an amount of memory with its unit is expected, such as 8 GiB, found 8"),
    "memory in no unit": (
        "name: galileo", "name: galileo\nsolver: {memory: 8 pages}", 1, "'8 pages' is no amount of memory"),
    "no threads": ("name: galileo", "name: galileo\nsolver: {threads: 0}", 1, "key 'solver.threads'"),
    "unknown solver": (
        "name: galileo", "name: galileo\nsolver: {backend: umfpack}", 1,
        "expected auto or pardiso or multifrontal or cholmod or superlu or mumps"),
    "no ranks": ("name: galileo", "name: galileo\nsolver: {ranks: 0}", 1, "key 'solver.ranks'"),
    "parts, which left": (
        "name: galileo", "name: galileo\nsolver: {parts: auto}", 1,
        "key 'solver.parts' has been removed. Bodies are not reduced in parts any more."),
    "parts of the pipeline, which left": (
        "name: galileo", "name: galileo\nparts: auto", 1,
        "key 'parts' has been removed. Bodies are not reduced in parts any more."),
    "parts of one body, which left": (
        "method: guyan", "method: guyan, parts: 16", 0,
        "key 'components.rotor.reduce.parts' has been removed. Bodies are not reduced in parts any more."),
    "alias of itself": ("cg: [0, 0, 0.2]", "cg: &a [*a]", 0, "contains itself through an alias"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "off", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistake_in_the_file(galileo, edited, old, new, off, words):
    line = galileo.read_text().partition(old)[0].count("\n") + 1 + off
    path = edited(old, new)
    with pytest.raises(ConfigError) as refused:
        load_pipeline(path)
    first = str(refused.value).splitlines()[0]
    assert first.startswith(f"{path}:{line}: ")
    assert words in first


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "balance.keeep=all",
            "key 'balance.keeep' is unknown: did you mean 'keep'? Known keys: rank, keep, weighting, scaling, clusters",
        ),
        (
            "reduce.cutoff=20 Hz",
            "key 'reduce.cutoff': found the text '20 Hz', expected a number without a unit, e.g. 2.0",
        ),
        ("components.rotor.damping.modal=0", "key 'components.rotor.damping.modal': damping modal: 0 is not positive"),
        ("balance.keep.modes.rotr=3", "there is no flexible component 'rotr', did you mean 'rotor'?"),
        ("components.rotor.balance.keep.frf_error=0.1", "ask for it under 'balance.keep'"),
        ("scene.articulation.spin.7=1 deg", "'scene.articulation.spin' has 3 items, counted from 0"),
        ("scene.articulation.cone.ry=9 deg", "the same motion is set by 'cone'"),
        (
            "components.rotor.interfaces.spin_bearing.node=99999999999999999999",
            "found the number 1e+20, expected a whole",
        ),
        ("verify.frf.points=9223372036854775808", "expected a whole number"),
        ("verify.frf.points=0xfffffffffffffffffffffff", "expected a whole number"),
        ("verify.frf.points=" + "9" * 400, "'verify.frf.points'"),
        ("solver.threads=99999999999", "solver.threads"),
        ("solver.ranks=99999999999", "solver.ranks"),
        ("scene.band=null", "key 'scene.band': null is not a number with a unit"),
        ("reduce.cutoff=!!float x", "--set reduce.cutoff=!!float x: the value: 'x' is not a number"),
        ("verify.limits={frf_error: 1 %, frf_error: 2 %}", "key 'frf_error' is given twice"),
        ("solver.memory=true", "an amount of memory with its unit is expected"),
        ("reduce.residuals=[99999999999999999999]", "is no residual"),
        ('reduce.residuals=["99999999999999999999.x"]', "is no residual"),
        ("reduce.residuals=[²]", "is no residual"),
        ("scene.articulation.spin.²=1 deg", "scene.articulation.spin"),
        ("scene.band=[1", "YAML syntax"),
        ("scene.band", "write KEY=VALUE"),
        ("scene..band=3", "write KEY=VALUE"),
        ("scene.band=", "there is no value"),
        ("include=other.yaml", "write 'include' into the file"),
    ],
)
def test_mistake_in_an_override(galileo, override, words):
    with pytest.raises(ConfigError) as refused:
        load_pipeline(galileo, [override])
    assert str(refused.value).startswith(f"--set {override}: ")
    assert words in str(refused.value)


def test_mistake_in_an_included_file(galileo):
    fragment = galileo.parents[1] / "configs/default.yaml"
    fragment.write_text(fragment.read_text().replace("db_error", "db_eror"))
    with pytest.raises(ConfigError) as refused:
        load_pipeline(galileo)
    where, _, message = str(refused.value).partition(": ")
    assert where.endswith("default.yaml:4")
    assert message.startswith("key 'verify.limits.db_eror' is unknown: did you mean 'db_error'?")


def test_an_included_file_by_a_path_of_windows(edited):
    path = edited("include: [../configs/default.yaml]", r"include: ['..\configs\default.yaml']")
    with pytest.raises(
        ReadError, match=r"galileo\.yaml:3: key 'include': .*; it is a path of Windows: write it with /"
    ):
        load_pipeline(path)


def test_all_mistakes_are_listed_in_order_a_line_each(edited):
    edited("cutoff: 3.0", "cutof: 3.0")
    edited("band: 10 Hz", "band: 10 s")
    path = edited("[hdf5]", "[hdf6]")
    with pytest.raises(ConfigError) as refused:
        load_pipeline(path)
    lines = re.findall(r"galileo\.yaml:(\d+): key '([\w.\[\]]+)'", str(refused.value))
    assert lines == [("25", "scene.band"), ("37", "reduce.cutof"), ("39", "write.formats[0]")]
    assert str(refused.value).count("\n") == 2


def test_of_many_mistakes_ten_are_listed(edited):
    path = edited("reduce: {cutoff: 3.0}", "\n".join(f"wrong{k}: 1" for k in range(14)))
    with pytest.raises(ConfigError) as refused:
        load_pipeline(path)
    lines = str(refused.value).splitlines()
    assert len(lines) == 11
    assert lines[-1] == "... and 4 more"


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        (
            "name: p\nscene: {band: 1\nreduce: {}\n",
            ":3:7",
            "YAML syntax: the bracket that opens in line 2 is not closed",
        ),
        ("name: p\nscene:\n\tband: 1\n", ":3:1", "YAML is indented with spaces, not with tabs"),
        ("name: a: b\n", ":1:8", "a text that holds ': ' needs quotes"),
        ("name: p\n---\nname: q\n", ":2:1", "a pipeline is one document"),
        ("name: *p\n", ":1:7", "found undefined alias"),
        ("scene: {a: *}\n", ":1:13", "but found '}'"),
        ("# nothing\n", "", "the file is empty"),
        ("- name\n", ":1", "a mapping of keys is expected"),
        ("[a]: 1\n", ":1", "keys are plain words"),
        ("name: 'p\x01'\n", "", "this is not YAML text"),
        (b"name: p\n# \xff\n", ":2", "save the file as UTF-8"),
        ("include: 3\n", ":1", "key 'include' takes file names"),
        ("name: p\n", ":1", "the pipeline lacks 'components', e.g. components: "),
        ("a: &a {<<: *a}\n", ":1", "takes in itself"),
        ("name: !!int p\n", ":1", "'p' is not a number"),
    ],
)
def test_files_that_are_no_pipeline(tmp_path, text, where, words):
    path = tmp_path / "p.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as refused:
        load_pipeline(path)
    assert str(refused.value).startswith(f"{path}{where}: ")
    assert words in str(refused.value)


def test_every_removed_key_is_in_the_notes_on_moving() -> None:
    """A key that is refused with what to write instead stands in the table of the changelog, too."""
    notes = (Path(__file__).parents[2] / "CHANGELOG.md").read_text().partition("### Moving from")[2].partition("###")[0]
    found, todo = set(), [Keys]
    while todo:
        grammar = todo.pop()
        todo += grammar.__subclasses__()
        found |= set(grammar.removed)
    assert {"parts", "rotate"} <= found
    assert all(re.search(rf"`(\w+\.)*{key}`", notes) for key in found), found
