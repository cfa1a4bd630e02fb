"""Check the mechanical rules of wording: python .ci/words.py [FOLDER ...].

1. The docstring of a function begins with a verb of the list; that of a class or a property does not.
2. No docstring and no comment begins with a word that lacks its noun ("What", "Those", "Of").
3. A function is named by a verb: neither by a participle ("checked") nor by "of". Public names and public
   methods of public classes are exempt.
4. What a public module exports has the sections of numpydoc: Parameters, Returns, and an example.

Every fault is printed with its file and line. The exit code is 1 if there is a fault.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

split = re.compile(r"\S+").findall
"""Split a text into words."""

ROOT = Path(__file__).resolve().parent.parent
VERBS = set(
    split("""
        Add Adapt Answer Append Apply Assemble Ask Average Begin Bisect Bound Build Call Carry Check Choose Clip Close
        Collapse Collect Combine Compare Compress Compute Condense Confirm Connect Continue Convert Copy Correct Count
        Create Cut Decide Delete Describe Display Divide Do Draw Drop Eliminate End Enter Estimate Evaluate Execute
        Export Extend Extrude Factorise Fail Fill Find Fit Follow Form Format Give Group Handle Hatch Hold Insert
        Integrate Interpolate Invert Join Judge Keep Label Launch Lay Limit Link List Load Lock Log Look Make Map
        March Mark Measure Merge Mirror Move Multiply Name Normalise Note Number Open Order Pack Pad Parse Place Plot
        Point Pose Predict Prepare Press Print Project Prove Put Raise Read Record Recover Reduce Refine Refuse
        Register Relax Release Remove Rename Renumber Repeat Replace Report Resolve Restrict Return Reverse Rotate
        Round Run Save Scale Search Select Send Serve Set Shift Show Simulate Skip Solve Sort Split Spread Start Step
        Stop Store Straighten Subtract Sum Suppress Sweep Take Tell Test Translate Triangulate Try Turn Undo Unpack
        Update Use Visit Wait Walk Warn Weigh Wrap Write Yield
    """)
)
NOUNLESS = set(split("What Whatever Which Whichever That Those Theirs Of By As Things Such Asked Who Whoever How"))
IRREGULAR = set(
    split("""
        begun bent built cut drawn driven felt found given held hidden kept known laid left made meant met put said seen
        sent shown spread taken thrown told written
    """)
)
NOT_PARTICIPLES = set(split("need speed seed feed embed proceed"))
PUBLIC = split("vemcvx effects meshes plots program testing vem estimate/measures")
"""Modules whose `__all__` is public; the public names of the package itself are in its stub."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def exports(module: str) -> set[str]:
    """Return the names that a public module exports."""
    folder = ROOT / "vemcvx" / ("" if module == "vemcvx" else module)
    if (stub := folder / "__init__.pyi").exists():
        imports = [
            node for node in ast.parse(stub.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)
        ]
        return {one.asname or one.name for node in imports for one in node.names}
    for node in ast.parse((folder / "__init__.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return {str(name.value) for name in ast.walk(node.value) if isinstance(name, ast.Constant)}
    return set()


EXPORTED = set().union(*map(exports, PUBLIC))


def is_property(node: Function) -> bool:
    """Return True if a function is read as an attribute."""
    return any("property" in ast.unparse(decorator) for decorator in node.decorator_list)


def openings(node: ast.AST, said: str) -> Iterator[str]:
    """Yield the faults of the first word of a docstring."""
    first = re.sub(r"^\W*", "", said).partition(" ")[0].strip(",.:;'\"")
    if first in NOUNLESS:
        yield f"its docstring begins with {first!r}, which names nothing"
    elif isinstance(node, Function) and not is_property(node):
        if not re.match(r"\w", said) or first not in VERBS:
            yield f"its docstring begins with {said.split()[0]!r}, which is no verb of the list"
    elif not isinstance(node, ast.Module) and first in VERBS - {"Set", "Step", "Name", "Number", "Point", "Place"}:
        yield f"its docstring begins with the verb {first!r}; a class or property is a noun"


def naming(node: Function) -> Iterator[str]:
    """Yield the fault of the name of a function."""
    first = node.name.strip("_").partition("_")[0]
    participle = first in IRREGULAR or (first.endswith("ed") and first not in NOT_PARTICIPLES)
    if (participle or first == "of") and not is_property(node) and node.name not in EXPORTED:
        yield f"its name begins with {first!r}; begin with a verb"


def sections(node: Function | ast.ClassDef, said: str) -> Iterator[str]:
    """Yield the sections of numpydoc that the docstring of an exported name lacks; overloads have none."""
    if any(ast.unparse(decorator) == "overload" for decorator in node.decorator_list):
        return
    wanted = {"Examples"}
    if isinstance(node, Function):
        wanted |= {"Parameters"} if node.args.args or node.args.kwonlyargs else set()
        wanted |= {"Returns"} if ast.unparse(node.returns or ast.Constant(None)) != "None" else set()
    elif any(isinstance(field, ast.AnnAssign) for field in node.body):
        wanted |= {"Attributes" if "Attributes\n" in said else "Parameters"}
    elif any("Error" in base or "Warning" in base for base in map(ast.unparse, node.bases)):
        return
    for section in sorted(wanted):
        if not re.search(rf"^{section}\n-+$", said, re.MULTILINE):
            yield f"it is public, and its docstring has no section {section!r}"


def faults(path: Path) -> Iterator[str]:
    """Yield the faults of a file, a line each."""
    text, where = path.read_text(encoding="utf-8"), path.relative_to(ROOT)
    tree = ast.parse(text)
    top = {id(node) for node in tree.body}
    public = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name in EXPORTED]
    methods = {id(node) for owner in public for node in owner.body if not getattr(node, "name", "_").startswith("_")}
    for node in ast.walk(tree):
        if not isinstance(node, (*Function.__args__, ast.ClassDef, ast.Module)):
            continue
        said, name = ast.get_docstring(node) or "", getattr(node, "name", "module")
        found = list(openings(node, said)) if said else []
        if isinstance(node, Function) and not name.startswith(("test_", "__")) and id(node) not in methods:
            found += naming(node)
        if id(node) in top and name in EXPORTED and where.parts[0] == "vemcvx":
            found += sections(node, said)
        yield from (f"{where}:{getattr(node, 'lineno', 1)}: {name}: {fault}." for fault in found)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        first = token.string.lstrip("# ").partition(" ")[0].strip(",.:;") if token.type == tokenize.COMMENT else ""
        if first in NOUNLESS and "lessons" not in where.parts:  # the comments of lessons are paragraphs
            yield f"{where}:{token.start[0]}: a comment begins with {first!r}, which names nothing."


def main() -> None:
    """Print the faults of the package and of the problems, or of the files and folders that are given."""
    given = [Path(name).resolve() for name in sys.argv[1:]] or [ROOT / "vemcvx", ROOT / "problems"]
    files = [one for path in given for one in ([path] if path.suffix == ".py" else sorted(path.rglob("*.py")))]
    found = [fault for path in files for fault in faults(path)]
    print("\n".join([*found, f"words: {len(found)} faults."]))
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
