"""The architecture holds: a room is entered by its face, and says what belongs there."""

import ast
import importlib
from pathlib import Path

import pytest

import cmsreduce

PACKAGE = Path(cmsreduce.__file__).parent
FILES = sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)
ROOMS = {path.parent for path in FILES if path.name == "__init__.py"} - {PACKAGE}
# Halls whose rooms are entered one by one; every other hall has one face for all of its rooms.
OPEN = {PACKAGE / "linalg"}


def module_file(name: str) -> Path | None:
    """File of a module or package of cmsreduce; None for a name inside a module."""
    path = PACKAGE.parent / Path(*name.split("."))
    return (
        path / "__init__.py"
        if path.is_dir()
        else path.with_suffix(".py")
        if path.with_suffix(".py").is_file()
        else None
    )


def imported(path: Path) -> set[tuple[Path, int]]:
    """Files of the package that a file imports, each with the line."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "cmsreduce":
            for name in node.names:
                file = module_file(f"{node.module}.{name.name}") or module_file(node.module)
                # `from room import function`, where a file of the room has the name of the function.
                if file is not None and file.stem == name.name and (face := module_file(node.module)) is not None:
                    file = face if hasattr(importlib.import_module(node.module), name.name) else file
                if file is not None:
                    found.add((file, node.lineno))
    return found


def entrance(path: Path, guest: Path) -> Path:
    """File by which a guest enters the room of a file: the file itself in the guest's own room or hall."""
    room = path.parent
    if room == PACKAGE or guest.parent == room or room in guest.parents:
        return path
    while room.parent != PACKAGE and room.parent not in OPEN and room.parent not in guest.parents:
        room = room.parent
    return path if room in OPEN else room / "__init__.py"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_rooms_are_entered_by_their_faces(path):
    wrong = [
        f"line {line}: {file.relative_to(PACKAGE)}"
        for file, line in imported(path)
        if file.name != "__init__.py" and entrance(file, path) != file
    ]
    assert not wrong, f"{path.relative_to(PACKAGE)} enters a room by a window: {', '.join(wrong)}"


@pytest.mark.parametrize("room", sorted(ROOMS), ids=lambda room: str(room.relative_to(PACKAGE)))
def test_a_room_says_what_belongs_there_and_what_does_not(room):
    said = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8"))) or ""
    assert len([part for part in said.replace("\n", " ").split(". ") if part.strip()]) >= 3, f"{room}: {said!r}"


@pytest.mark.parametrize("room", sorted(ROOMS), ids=lambda room: str(room.relative_to(PACKAGE)))
def test_every_name_of_a_face_is_there(room):
    face = importlib.import_module(".".join(("cmsreduce", *room.relative_to(PACKAGE).parts)))
    assert all(hasattr(face, name) for name in getattr(face, "__all__", ()))
