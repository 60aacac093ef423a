"""Commands about the program and its files rather than about a body: cache, doctor, completion, schema, new."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmsreduce.cli.file_names import PATH
from cmsreduce.cli.options import Commands, output_options
from cmsreduce.errors import WriteError

if TYPE_CHECKING:
    from cmsreduce.report import Output

__all__ = ["household"]

household = Commands()
"""The commands of this file; the program takes them as its own."""


@household.group()
def cache() -> None:
    """List or clear the finished stages of a run or of a sweep."""


@cache.command(name="ls")
@click.argument("run_dir", type=PATH)
def cache_ls(run_dir: Path) -> None:
    """List finished stages: stage, body, first digits of the key, size, time."""
    from datetime import datetime

    from cmsreduce.pipeline.store import cache_entries

    entries = cache_entries(run_dir)
    for entry in entries:
        made = datetime.fromtimestamp(entry.made).isoformat(" ", "seconds")
        key = entry.key or "damaged"
        click.echo(f"{entry.stage:<13} {entry.what:<20} {key:<12} {entry.size / 2**20:9.2f} MiB  {made}  {entry.path}")
    click.echo(f"{len(entries)} finished stages, {sum(entry.size for entry in entries) / 2**20:.2f} MiB")


@cache.command(name="clear")
@click.argument("run_dir", type=PATH)
def cache_clear(run_dir: Path) -> None:
    """Remove finished stages; results stay, and the next run computes everything anew."""
    from cmsreduce.pipeline.store import clear_cache

    count, size, kept = clear_cache(run_dir)
    for path in kept:
        click.echo(f"{path} stays: it is damaged, or cmsreduce did not write it")
    click.echo(f"removed {count} files, {size / 2**20:.2f} MiB")


@household.command()
@click.option("--compile", "compiling", is_flag=True, help="Compile the loops of the multifrontal solver first.")
@output_options
def doctor(compiling: bool, output: Output) -> None:
    """Show what a run finds here: versions, sparse solvers, threads, memory, disk, compiled loops.

    The loops are compiled once on a machine, in about half a minute: by `--compile`, or by the first body of 50 000
    dofs.
    """
    from cmsreduce.pipeline import environment

    if compiling:
        from cmsreduce.multifrontal import compile_loops, lacks

        if not lacks():
            compile_loops()
    lines = environment(Path())
    for line in lines:
        output.line(f"{line.name:<16} {line.words}{f'  ({line.advice})' if line.advice else ''}")
    output.result({line.name: line.value for line in lines})


@household.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script that completes commands, options, keys, stages and formats in a shell.

    For bash: `cmsreduce completion bash > ~/.cmsreduce-complete.bash`, and in ~/.bashrc `. ~/.cmsreduce-complete.bash`.
    """
    from click.shell_completion import get_completion_class

    made = get_completion_class(shell)
    assert made is not None
    click.echo(made(click.get_current_context().find_root().command, {}, "cmsreduce", "_CMSREDUCE_COMPLETE").source())


@household.command()
def schema() -> None:
    """Print the JSON Schema of the pipeline file."""
    import json

    from cmsreduce.config import json_schema

    click.echo(json.dumps(json_schema(), indent=2))


_SCHEMA = "cmsreduce.schema.json"


def _written(path: Path, text: str) -> None:
    """Write a draft, with the schema by which editors complete and check its keys."""
    import json

    from cmsreduce.config import json_schema
    from cmsreduce.write import atomic_path

    with atomic_path(path) as temporary:
        temporary.write_text(f"# yaml-language-server: $schema={_SCHEMA}\n{text}", encoding="utf-8")
    if not (schema_file := path.with_name(_SCHEMA)).exists():
        with atomic_path(schema_file) as temporary:
            temporary.write_text(json.dumps(json_schema(), indent=1), encoding="utf-8")


@household.command()
@click.argument("name")
@click.argument("files", nargs=-1, metavar="[FILE]...", type=PATH)
def new(name: str, files: tuple[Path, ...]) -> None:
    """Write a commented starter pipeline NAME.yaml.

    With FILEs it is filled in and can be run: the matrices of a body and the deck or mesh they came from, whatever
    their names, or those of several bodies, which are joined where their nodes coincide or their faces meet. Editors
    find the keys in cmsreduce.schema.json beside it.
    """
    from cmsreduce.config import starter_pipeline

    path = Path(f"{name}.yaml")
    if path.exists():
        raise WriteError(f"{path} exists; choose another name or remove it: cmsreduce new {name}2 ...")
    if not files:
        _written(path, starter_pipeline(name))
        click.echo(f"{path} written; fill in your files, then: cmsreduce run {path}")
        click.echo(f"or have it filled in: cmsreduce new {name}2 MATRICES.op4 DECK.bdf")
        return
    from cmsreduce.pipeline.drafts import draft_pipeline
    from cmsreduce.pipeline.store import collecting

    with collecting() as failures:
        draft = draft_pipeline(name, files)
    _written(path, draft.text)
    for warning in (*draft.warnings, *(failure.line for failure in failures)):
        click.echo(f"warning: {warning}", err=True)
    click.echo(f"{path} written; look at the lines marked CHECK, then: cmsreduce run {path}")
