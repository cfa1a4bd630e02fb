"""Fits of parameters to measurements with noise, fields of friction bounds, and the command `vemcvx fit`."""

import numpy as np
import pytest
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli.commands import app
from vemcvx.cli.fitting import read_measured

TRUTH = np.array([200.0, 0.3, 0.4])
OF = "reaction of top x", "reaction of top y"
TIMES = np.linspace(0.0, 1.0, 65)
MESH = vx.meshes.squares(6)


def loop(theta):
    """Return the scene of a block on rough ground, pushed to and fro."""
    young, poisson, friction = theta
    move = vx.PrescribedDisplacement(lambda x, t: [0.03 * np.sin(2.0 * np.pi * t), -0.01 * min(4.0 * t, 1.0)], on="top")
    rough = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(friction, on="bottom")
    return vx.Scene(vx.Elasticity(young, poisson), move, *rough)


def fit_draws(draws):
    """Return the errors (draws, 3) of fits to noisy loops, divided by their standard errors."""
    exact = vx.sensitivities(loop, TRUTH, MESH, TIMES, OF).values
    found = []
    for seed in range(draws):
        noise = (
            0.01 * np.abs(exact).max(axis=1, keepdims=True) * np.random.default_rng(seed).standard_normal(exact.shape)
        )
        measured = dict(zip(OF, exact + noise, strict=True))
        fit = vx.fit(loop, [120.0, 0.2, 0.6], MESH, TIMES, measured, bounds=([1.0, 0.0, 0.0], [np.inf, 0.45, 5.0]))
        found.append((fit.theta - TRUTH) / fit.errors)
    return np.array(found)


def test_a_fit_finds_young_poisson_and_friction_from_a_noisy_loop():
    assert (np.abs(fit_draws(2)) <= 3.0).all()


@pytest.mark.slow
def test_standard_errors_cover_the_truth_in_nineteen_of_twenty_draws():
    """With a probability of 99 %, at least 53 of 60 Gaussian errors are within two standard errors."""
    assert (np.abs(fit_draws(20)) <= 2.0).sum() >= 53


def test_without_noise_a_fit_ends_at_the_parameters_of_the_loop():
    exact = vx.sensitivities(loop, TRUTH, MESH, TIMES[::8], OF)
    measured = dict(zip(OF, exact.values, strict=True))
    found = vx.fit(loop, [150.0, 0.25, 0.5], MESH, TIMES[::8], measured, names=("young", "poisson", "friction"))
    np.testing.assert_allclose(found.theta, TRUTH, rtol=1e-7)
    assert "poisson" in found.outline().text()
    assert found.runs < 20


def test_a_parameter_without_influence_has_an_infinite_error():
    """The friction bound of a block that sticks does not change the displacement of the top."""

    def scene_of(theta):
        pull = vx.Traction(lambda x, t: [theta[0] * t, 0.0], on="right")
        rough = vx.BilateralContact(on="bottom"), vx.TrescaFriction(theta[1], on="bottom")
        return vx.Scene(vx.Elasticity(200.0, 0.0), vx.Clamp(on="left"), pull, *rough)

    measured = {"displacement at (1, 1) x": [0.0, 0.005]}
    found = vx.fit(scene_of, [1.0, 100.0], vx.meshes.squares(2), [0.0, 1.0], measured, noise=1e-4)
    assert np.isinf(found.errors[1])
    assert found.errors[0] == pytest.approx(found.theta[0] * 1e-4 / 0.005, rel=1e-6)


KNOTS = np.linspace(0.0, 1.0, 9)


def hats(x):
    """Return the hat functions (k, 9) of the knots at points x (k, 2)."""
    return np.stack([np.interp(x[:, 0], KNOTS, one) for one in np.eye(len(KNOTS))], axis=1)


def joint(theta):
    """Return the scene of a strip on ground with a variable friction bound."""
    pull = vx.Traction(lambda x, t: [1.2 * t, 0.0], on="right")
    rough = vx.BilateralContact(on="bottom"), vx.TrescaFriction(lambda x, t: hats(x) @ theta, on="bottom")
    return vx.Scene(vx.Elasticity(10.0, 0.0), pull, vx.Symmetry(on="left"), *rough)


def gripped(theta):
    """Return the scene of a block on ground with a variable coefficient of friction."""
    move = vx.PrescribedDisplacement(lambda x, t: [0.02 * t, -0.01], "top")
    rough = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(lambda x, t: hats(x) @ theta, on="bottom")
    return vx.Scene(vx.Elasticity(200.0, 0.3), move, *rough)


@pytest.mark.parametrize(
    ("scene_of", "mesh", "of"),
    [
        (joint, vx.meshes.squares((16, 4)), ["displacement at (1, 0.25) x", "dissipated"]),
        (gripped, MESH, OF),
    ],
)
def test_a_field_of_bounds_or_coefficients_has_the_same_derivatives_by_shapes_and_by_differences(scene_of, mesh, of):
    theta, times = 0.2 + 0.1 * np.cos(5.0 * KNOTS), [0.0, 0.5, 1.0]
    found, other = (
        vx.sensitivities(scene_of, theta, mesh, times, of, shapes=shapes, initial="settled") for shapes in (hats, None)
    )
    assert found.history.contact.slip_count[-1] > 0
    size, weights = np.abs(found.jacobian).max(), np.ones(found.values.shape)
    np.testing.assert_allclose(found.jacobian, other.jacobian, atol=1e-8 * size)
    np.testing.assert_allclose(found.gradient(weights), found.jacobian.sum(axis=(0, 1)), atol=1e-11 * size)


def test_the_command_fits_parameters_of_a_problem_to_a_table(tmp_path):
    problem = tmp_path / "loop.py"
    problem.write_text(
        "import numpy as np\nimport vemcvx as vx\n"
        "def scene(young=150.0, friction=0.5):\n"
        "    move = vx.PrescribedDisplacement(lambda x, t: [0.03 * np.sin(6 * t), -0.01 * min(4 * t, 1.0)], on='top')\n"
        "    rough = vx.UnilateralContact(on='bottom'), vx.CoulombFriction(friction, on='bottom')\n"
        "    return vx.Scene(vx.Elasticity(young, 0.3), move, *rough)\n"
        "def mesh(n, family='squares'):\n    return vx.meshes.squares(n)\n"
        "def times(steps):\n    return np.linspace(0.0, 1.0, steps + 1)\n"
    )
    from vemcvx.cli.problem_file import read_problem

    times, of = np.linspace(0.0, 1.0, 9), "reaction of top x"
    values = vx.sensitivities(
        lambda theta: read_problem(problem).scene([f"young={theta[0]}", f"friction={theta[1]}"]),
        [200.0, 0.4],
        vx.meshes.squares(4),
        times,
        [of],
    ).values[0]
    table = tmp_path / "loop.csv"
    rows = [f"{t},{'' if n == 3 else value}" for n, (t, value) in enumerate(zip(times, values, strict=True))]
    table.write_text("\n".join([f"t,{of}", *rows]))
    call = ["fit", str(problem), "--measured", str(table), "--by", "young,friction", "--n", "4"]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    assert " 200 with" in done.stdout
    assert " 0.4 with" in done.stdout
    wrong = CliRunner().invoke(app, [*call[:5], "youg", *call[6:]])
    assert wrong.exit_code == 2
    assert "young, friction" in wrong.output


@pytest.mark.parametrize("text", ["", "t,f,f\n0,1,2", "s,f\n0,1", "t,f\n0,1,2", "t;f\n0;1", "t,f\n0," + "1" * 200_000])
def test_a_table_that_cannot_be_read_is_refused_in_words(tmp_path, text):
    (tmp_path / "loop.csv").write_text(text)
    with pytest.raises(vx.ProblemError, match="Wanted a table with commas"):
        read_measured(tmp_path / "loop.csv")


@pytest.mark.parametrize(
    ("value", "start", "options", "words"),
    [
        (np.inf, 0.5, {}, "not finite .* Wanted: .* measurements finite or NaN"),
        (1.0, 0.5, {"bounds": ([150.0, 0.0, 0.0], [150.0, 0.4, 1.0])}, "Wanted: lower bounds < upper bounds"),
        (1.0, 0.7, {"bounds": (0.0, 0.6)}, "Wanted: .* theta_0 between the bounds"),
        (1.0, 0.5, {"penalty": [[np.nan, 0.0, 0.0]] * 3}, "not finite .* Wanted: .* penalty"),
        (1.0, 0.5, {"noise": None}, "2 values cannot determine 3 parameters and the noise; give noise="),
        (1.0, 0.0, {"penalty": np.eye(3)}, "changes the unknowns"),
    ],
)
def test_fits_that_cannot_begin_are_refused(value, start, options, words):
    with pytest.raises(vx.SceneError, match=words):
        vx.fit(loop, [150.0, 0.25, start], MESH, [0.0, 1.0], {OF[0]: [0.0, value]}, **{"noise": 1.0, **options})


def test_a_search_that_leaves_the_lawful_parameters_points_to_bounds():
    def scene_of(theta):
        return vx.Scene(vx.Elasticity(theta[0], 0.3), vx.Clamp(on="left"), vx.Traction((1.0, 0.0), on="right"))

    softer = vx.sensitivities(scene_of, [50.0], MESH, [0.0, 1.0], ["energy"], initial="settled").values[0]
    with pytest.raises(vx.SceneError, match="young = 0 in cell 0; .* by bounds="):
        vx.fit(scene_of, [200.0], MESH, [0.0, 1.0], {"energy": softer}, initial="settled")
