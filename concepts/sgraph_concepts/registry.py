"""The registry of concepts: loads plugins one at a time and keeps what is sound."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import EntryPoint, entry_points
from importlib.resources.abc import Traversable
from typing import Any

import pluggy

from sgraph_concepts import hookspecs
from sgraph_concepts.errors import ConceptError, PluginError, one_line
from sgraph_concepts.hookspecs import ENTRY_POINT_GROUP
from sgraph_concepts.spec import WALL_SURFACE, ConceptSpec, resolve

__all__ = ["PluginProblem", "RegisteredConcept", "Registry"]

OWN_DISTRIBUTION = "sgraph-concepts"


@dataclass(frozen=True)
class RegisteredConcept:
    """A concept and where it came from.

    Attributes:
        spec: its declaration.
        package: the package that declared it, which holds its weights; empty for none.
        distribution: the installed distribution, empty if it was added by hand.
        version: the distribution's version, likewise.
    """

    spec: ConceptSpec
    package: str = ""
    distribution: str = ""
    version: str = ""

    def weights_file(self) -> Traversable:
        """Return the head's weights inside the declaring package.

        Raises:
            ConceptError: the concept has no head, or nobody said which package holds its weights.
        """
        if self.spec.head is None:
            raise ConceptError(f"concept {self.spec.name!r} has no head, hence no weights")
        if not self.package:
            raise ConceptError(
                f"concept {self.spec.name!r}: add(spec, package=...) must name the package that "
                f"holds {self.spec.head.weights!r}"
            )
        return importlib.resources.files(self.package) / self.spec.head.weights


@dataclass(frozen=True)
class PluginProblem:
    """A plugin, or one concept of it, that is left out; the others keep working.

    Attributes:
        entry_point: name of the entry point.
        distribution: installed distribution that declares it.
        version: its version.
        reason: what went wrong, one line.
        remedy: what the user can do about it.
    """

    entry_point: str
    distribution: str
    version: str
    reason: str
    remedy: str

    def __str__(self) -> str:
        return (
            f"plugin {self.entry_point!r} of {self.distribution} {self.version} is left out: "
            f"{self.reason}; {self.remedy}"
        )


class _Declarations:
    """Collects one plugin's declarations, so that a plugin that fails halfway adds nothing."""

    def __init__(self) -> None:
        self.specs: list[ConceptSpec] = []

    def add(self, spec: ConceptSpec) -> None:
        if not isinstance(spec, ConceptSpec):
            raise ConceptError(f"add() takes a ConceptSpec, not {type(spec).__name__}")
        self.specs.append(spec)


class Registry:
    """The known concepts, in an order in which each comes after what it groups.

    Args:
        encoder: version of the shared encoder that is installed; heads of another are refused.
        builtins: references of the parts that declarations may name, by kind and bare name.
    """

    def __init__(
        self, encoder: str, builtins: Mapping[str, Mapping[str, str]] | None = None
    ) -> None:
        self.encoder = encoder
        self.problems: list[PluginProblem] = []
        self._builtins = dict(builtins or {})
        self._concepts: dict[str, RegisteredConcept] = {}

    def add(
        self, spec: ConceptSpec, *, package: str = "", distribution: str = "", version: str = ""
    ) -> None:
        """Add one concept.

        Raises:
            ConceptError: its name is taken, or its head belongs to another encoder.
        """
        if spec.name == WALL_SURFACE:
            raise ConceptError(f"{WALL_SURFACE!r} is the map's own layer and no concept's name")
        if spec.name in self._concepts:
            other = self._concepts[spec.name].distribution or "this process"
            raise ConceptError(f"concept {spec.name!r} is already declared by {other}")
        if spec.head is not None and spec.head.encoder != self.encoder:
            raise ConceptError(
                f"the head of concept {spec.name!r} was trained on encoder "
                f"{spec.head.encoder!r}, but the installed one is {self.encoder!r}"
            )
        self._concepts[spec.name] = RegisteredConcept(spec, package, distribution, version)

    def load_entry_points(self) -> None:
        """Load the installed plugins, each on its own.

        A plugin that fails to import, that clashes with another, or that declares nonsense becomes
        an entry of ``problems``.
        """
        for entry_point in sorted(entry_points(group=ENTRY_POINT_GROUP), key=_precedence):
            try:
                self._load(entry_point)
            except PluginError as error:
                self.problems.append(_problem(entry_point, str(error), _remedy(entry_point)))
        self._drop_misplaced()

    def _load(self, entry_point: EntryPoint) -> None:
        distribution, version = _distribution(entry_point), _version(entry_point)
        declarations = _Declarations()
        try:
            plugin = entry_point.load()
            manager = pluggy.PluginManager(ENTRY_POINT_GROUP)
            manager.add_hookspecs(hookspecs)
            manager.register(plugin, name=entry_point.name)
            manager.check_pending()
            manager.hook.sgraph_register(registry=declarations)
        except (Exception, SystemExit) as error:  # a third party's code may raise anything
            raise PluginError(f"{type(error).__name__}: {one_line(error)}") from error
        if not declarations.specs:
            raise PluginError("it declares no concept (no sgraph_register hook?)")
        for spec in declarations.specs:
            try:
                self.add(
                    spec,
                    package=_package(plugin),
                    distribution=distribution,
                    version=version,
                )
            except ConceptError as error:
                self.problems.append(_problem(entry_point, str(error), _remedy(entry_point)))

    def _drop_misplaced(self) -> None:
        """Leave out concepts that group an unknown concept, or one another in a circle."""
        while True:
            known = {WALL_SURFACE, *self._concepts}
            lost = [c for c in self._concepts.values() if c.spec.groups not in known]
            reasons = [f"it groups {c.spec.groups!r}, which no plugin declares" for c in lost]
            if not lost:
                try:
                    self.ordered()
                except ConceptError as error:
                    circle = _circle(self._concepts)
                    lost = [self._concepts[name] for name in circle]
                    reasons = [str(error)] * len(lost)
            if not lost:
                return
            for concept, reason in zip(lost, reasons, strict=True):
                del self._concepts[concept.spec.name]
                self.problems.append(
                    PluginProblem(
                        concept.spec.name,
                        concept.distribution,
                        concept.version,
                        reason,
                        f"install the plugin that declares {concept.spec.groups!r}, "
                        f"or remove {concept.distribution}",
                    )
                )

    def ordered(self) -> list[RegisteredConcept]:
        """Return the concepts, each after what it groups, otherwise by name.

        Raises:
            ConceptError: concepts group one another in a circle.
        """
        sorter: TopologicalSorter[str] = TopologicalSorter()
        for name in sorted(self._concepts):
            groups = self._concepts[name].spec.groups
            sorter.add(name, *([groups] if groups in self._concepts else []))
        try:
            return [self._concepts[name] for name in sorter.static_order()]
        except CycleError as error:
            raise ConceptError(
                f"concepts group one another in a circle: {' -> '.join(error.args[1])}"
            ) from error

    def __iter__(self) -> Iterator[RegisteredConcept]:
        return iter(self.ordered())

    def __len__(self) -> int:
        return len(self._concepts)

    def __contains__(self, name: object) -> bool:
        return name in self._concepts

    def __getitem__(self, name: str) -> RegisteredConcept:
        """Return one concept.

        Raises:
            ConceptError: it is unknown.
        """
        if name not in self._concepts:
            known = ", ".join(sorted(self._concepts)) or "none"
            raise ConceptError(f"there is no concept {name!r} (known: {known})")
        return self._concepts[name]

    def select(self, names: list[str] | None) -> list[RegisteredConcept]:
        """Return the named concepts and what they group, in order; all for ``None``.

        Raises:
            ConceptError: a name is unknown.
        """
        if names is None:
            return self.ordered()
        wanted: set[str] = set()
        for name in names:
            current = name
            while current != WALL_SURFACE:
                wanted.add(current)
                current = self[current].spec.groups
        return [concept for concept in self.ordered() if concept.spec.name in wanted]

    def part(self, name: str, kind: str, reference: str | None = None) -> Any:
        """Return a part of a concept, imported on first use.

        Args:
            name: the concept.
            kind: ``baseline``, ``clusterer``, ``shape``, ``factor`` or ``labeller``.
            reference: use this one instead of the declared one.

        Raises:
            ConceptError: the concept has no such part, or it cannot be loaded.
        """
        chosen = reference or getattr(self[name].spec, kind)
        if chosen is None:
            raise ConceptError(f"concept {name!r} has no {kind}")
        return resolve(chosen, self._builtins.get(kind, {}), f"{kind} of concept {name!r}")


def _precedence(entry_point: EntryPoint) -> tuple[bool, str, str]:
    """Sort what ships with the framework first: nobody takes a name away from it by accident."""
    distribution = _distribution(entry_point)
    return distribution != OWN_DISTRIBUTION, distribution, entry_point.name


def _circle(concepts: Mapping[str, RegisteredConcept]) -> set[str]:
    """Return the concepts from which following 'groups' never ends."""
    endless = set()
    for start in concepts:
        seen, current = set(), start
        while current in concepts and current not in seen:
            seen.add(current)
            current = concepts[current].spec.groups
        if current in seen:
            endless.add(start)
    return endless


def _package(plugin: Any) -> str:
    module = getattr(plugin, "__package__", None)
    if module is None:
        module = type(plugin).__module__.rpartition(".")[0]
    return str(module)


def _distribution(entry_point: EntryPoint) -> str:
    return entry_point.dist.name if entry_point.dist else "an unknown distribution"


def _version(entry_point: EntryPoint) -> str:
    return entry_point.dist.version if entry_point.dist else ""


def _problem(entry_point: EntryPoint, reason: str, remedy: str) -> PluginProblem:
    return PluginProblem(
        entry_point.name, _distribution(entry_point), _version(entry_point), reason, remedy
    )


def _remedy(entry_point: EntryPoint) -> str:
    distribution = _distribution(entry_point)
    return f"upgrade it or remove it with 'pip uninstall {distribution}'"
