"""Write the JSON Schema of every document: ``python -m bayes_asv.report.schema [FOLDER]``."""

from __future__ import annotations

import ast
import inspect
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from bayes_asv.report.schema import DOCUMENTS
from bayes_asv.report.schema.parts import Model

__all__ = ["json_schemas", "main"]


class _Described(GenerateJsonSchema):
    """JSON Schema whose fields have the texts below them in the classes as descriptions.

    Pydantic can read them as well, but does so whenever a class is imported, which takes longer
    than all else in it.
    """

    def model_schema(self, schema: Any) -> dict[str, Any]:
        """Describe the fields of a class."""
        out = super().model_schema(schema)
        fields = schema["cls"].model_fields
        for base in reversed(schema["cls"].__mro__):
            base = getattr(base, "__pydantic_generic_metadata__", {}).get("origin") or base
            if not issubclass(base, Model):
                continue
            for name, text in _texts(base).items():
                field = out["properties"].get(fields[name].alias or name)
                if field is not None and fields[name].description is None:
                    field["description"] = text
        return out


@cache
def _texts(model: type[Model]) -> dict[str, str]:
    """Return the texts below the fields of a class."""
    (node,) = ast.parse(inspect.getsource(model)).body
    assert isinstance(node, ast.ClassDef)
    found = {}
    for field, below in zip(node.body, node.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
        ):
            found[field.target.id] = inspect.cleandoc(str(below.value.value))
    return found


def json_schemas() -> dict[str, str]:
    """Text of every JSON Schema by file name, such as ``estimate-1.json``."""
    files = {}
    for name, document in DOCUMENTS.items():
        schema = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            **document.model_json_schema(schema_generator=_Described),
        }
        kind, version = name.split("/")[1:]
        text = json.dumps(schema, indent=1, ensure_ascii=False, sort_keys=True)
        files[f"{kind}-{version}.json"] = text + "\n"
    return files


def main(folder: str = "docs/schema") -> None:
    """Write the files."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for name, text in json_schemas().items():
        (target / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:2])
