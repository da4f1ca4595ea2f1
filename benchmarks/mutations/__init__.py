"""Small faults put into the product one at a time: do the tests that mirror the file notice?"""

from __future__ import annotations

from benchmarks.mutations.mirror import mirroring
from benchmarks.mutations.mutant import Mutant, mutants_of

__all__ = ["Mutant", "mirroring", "mutants_of"]
