"""A pipeline file that is small but means a lot is refused with one message, quickly."""

import time

import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError

# Nine levels of ten aliases each: 10^9 entries.
ALIASES = "a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 10))
MERGES = "a0: &a0 {x: 1}\n" + "".join(
    f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 10)}]\n  y{k}: 1\n" for k in range(1, 10)
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (ALIASES, "with its aliases and merges written out, the file has more than 200000 entries"),
        (MERGES, "with its aliases and merges written out, the file has more than 200000 entries"),
        ("name: " + "[" * 5000 + "]" * 5000, "more than 50 lists or mappings inside each other"),
        ("name: " + "{a: " * 5000 + "}" * 5000, "more than 50 lists or mappings inside each other"),
        ("".join(f"{' ' * k}k:\n" for k in range(400)), "more than 50 lists or mappings inside each other"),
        ("a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 400)), "or 50 levels"),
        ("name: " + "x" * 100_000, "key 'name' has 100000 characters"),
        ("x" * 100_000 + ": 1", "a key of 'the file' has 100000 characters|YAML syntax"),
        ("name: " + "9" * 1900, "key 'name'"),
        ("# " + "x" * 600_000, "the file has 600002 characters"),
    ],
    ids=["aliases", "merges", "lists", "mappings", "blocks", "chain", "text", "key", "number", "file"],
)
def test_a_small_file_cannot_ask_for_much(tmp_path, text, says):
    path = tmp_path / "bomb.yaml"
    path.write_text(text)
    started = time.process_time()
    with pytest.raises(ConfigError, match=says) as error:
        load_pipeline(path)
    assert time.process_time() - started < 10
    assert len(str(error.value)) < 8000


def test_an_anchor_that_is_used_again_is_no_bomb(tmp_path):
    path = tmp_path / "good.yaml"
    body = "stiffness: a.op4\n    mass: b.op4"
    path.write_text(
        f"name: two\ncomponents:\n  a: &a\n    {body}\n  b:\n    <<: *a\nscene: {{band: 10 Hz}}\nreduce: {{}}\n"
    )
    assert list(load_pipeline(path).components) == ["a", "b"]


def test_a_file_that_many_files_include_is_read_once(tmp_path, monkeypatch):
    for k in range(40):
        (tmp_path / f"f{k}.yaml").write_text(f"include: [f{k + 1}.yaml, f{k + 1}.yaml]\nreduce: {{cutoff: 2.0}}\n")
    (tmp_path / "f40.yaml").write_text(
        "name: last\nscene: {band: 10 Hz}\ncomponents: {a: {rigid: {mass: 1.0, inertia: [1, 1, 1, 0, 0, 0]}}}\n"
    )
    assert load_pipeline(tmp_path / "f0.yaml").name == "last"
