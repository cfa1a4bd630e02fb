"""The choice of linear solvers depends on the number of unknowns, and on the packages that are installed."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import pose_block_on_floor

import vemcvx as vx
from vemcvx.linear import Iterative, Pardiso, SuperLU, choose_linear


@pytest.mark.parametrize("installed", [True, False])
def test_iterative_solvers_start_at_fewer_unknowns_in_space_than_in_the_plane(monkeypatch, installed):
    monkeypatch.setattr(Pardiso, "is_installed", staticmethod(lambda: installed))
    direct = Pardiso() if installed else SuperLU()
    able = Iterative() if find_spec("pyamg") else direct
    assert choose_linear(100) == SuperLU()
    assert choose_linear(100, Iterative(tolerance=1e-8)) == Iterative(tolerance=1e-8)
    assert choose_linear(66_825, modes=6) == direct
    assert choose_linear(2_000_000, modes=6) == able
    assert choose_linear(260_000, modes=6) == (direct if installed else able)
    assert choose_linear(2_000_000, modes=3) == direct
    monkeypatch.setattr(SuperLU, "largest_in_space", 1)
    system = pose_block_on_floor(2, lambda t: np.zeros(3))
    assert system.linear() == (Iterative() if find_spec("pyamg") else SuperLU())
    assert replace(system, near_kernel=None).linear() == SuperLU()


def test_a_solver_that_is_not_installed_is_not_chosen(monkeypatch):
    monkeypatch.setattr(vx.linear.pardiso, "PACKAGE", "not_there_at_all")
    assert choose_linear(1_000_000) == SuperLU()
    with pytest.raises(vx.NotAccepted, match=r"^Pardiso: the package py-mkl-pardiso .* not installed; pip .*SuperLU"):
        vx.Pardiso().factorise(sp.eye_array(3, format="csr"))


def test_missing_packages_of_petsc_are_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    vx.linear.petsc.all_ranks.cache_clear()
    with pytest.raises(vx.NotAccepted, match=r"^PETSc: petsc4py or mpi4py cannot be loaded .*; install Debian's"):
        vx.PETSc().factorise(sp.eye_array(3, format="csr"))
