"""Barrier rows are the derivatives they claim to be, and point the safe way."""

import numpy as np
import pytest

from layered_cbf_ros.coordination.agent_agent import AgentAgent
from layered_cbf_ros.coordination.agent_obstacle import AgentObstacle
from layered_cbf_ros.coordination.agent_wall import AgentWall
from layered_cbf_ros.coordination.barriers import Bodies, Scene
from layered_cbf_ros.coordination.parameters import CoordinatorParameters
from layered_cbf_ros.scenario import Wall

P = CoordinatorParameters()
NAMES = ('a', 'b', 'c')
RADII = np.full(3, P.agent_radius)
WALLS = (Wall('left', (0.0, 3.0), (0.0, -1.0)), Wall('right', (0.0, -3.0), (0.6, 0.8)))


def random_scene(seed, position=None, held=(False, False, False)):
    rng = np.random.default_rng(seed)
    bodies = Bodies(
        ('o', 'p'),
        rng.uniform(-3.0, 3.0, (2, 2)),
        rng.uniform(-0.5, 0.5, (2, 2)),
        np.full(2, 0.3),
        np.full(2, 1.02),
        np.full(2, 0.05),
    )
    agents = rng.uniform(-3.0, 3.0, (3, 2)) if position is None else position
    velocity, target = rng.uniform(-0.5, 0.5, (2, 3, 2))
    return Scene(agents, velocity, target, np.array(held), any(held), bodies)


def moved(scene, u, t):
    """Return the scene t later: agents under u, bodies at constant velocity."""
    bodies = scene.bodies
    later = Bodies(
        bodies.names,
        bodies.position + t * bodies.velocity,
        bodies.velocity,
        bodies.radius,
        bodies.horizon,
        bodies.growth,
    )
    return Scene(
        scene.position + t * scene.velocity + 0.5 * t * t * u,
        scene.velocity + t * u,
        scene.target,
        scene.held,
        scene.any_held,
        later,
    )


def pair_distances(scene):
    i, j = [0, 0, 1], [1, 2, 2]
    return np.hypot(*(scene.position[j] - scene.position[i]).T)


def obstacle_distances(scene):
    between = scene.bodies.position[None] - scene.position[:, None]
    return np.hypot(between[..., 0], between[..., 1]).reshape(-1)


def wall_distances(scene):
    normal = np.array([wall.normal for wall in WALLS])
    return (scene.position @ normal.T).reshape(-1)


KINDS = {
    'agents': (AgentAgent(NAMES, RADII, P), pair_distances, P.alpha1, P.alpha2),
    'obstacles': (AgentObstacle(NAMES, RADII, P), obstacle_distances, P.alpha1, P.alpha2),
    'walls': (AgentWall(NAMES, RADII, WALLS, P), wall_distances, P.wall_alpha1, P.wall_alpha2),
}


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('seed', range(8))
def test_rows_are_the_derivatives_along_a_trajectory(kind, seed):
    """Central differences of the distance, the size of the ball frozen.

    psi0(t) = psi0 + d(t) - d(0): the ball is carried by the object and keeps its radius.
    Steps of 1e-4 s leave 1e-8 in d' and 1e-5 in d'' (rounding 1e-15 / 1e-8, times 10).
    """
    barrier, distances, alpha1, alpha2 = KINDS[kind]
    scene = random_scene(seed)
    u = np.random.default_rng(seed + 100).uniform(-1.5, 1.5, (3, 2))
    rows, step = barrier.rows(scene), 1e-4
    before, now, after = (distances(moved(scene, u, t)) for t in (-step, 0.0, step))
    rate, acceleration = (after - before) / (2 * step), (after - 2 * now + before) / step**2
    psi1 = rate + alpha1 * rows.psi0
    assert np.allclose(rows.psi1, psi1, atol=1e-7)
    psi2 = acceleration + alpha1 * rate + alpha2 * psi1
    computed = np.einsum('mnk,nk->m', rows.coefficients, u) - rows.bound
    assert np.allclose(computed, psi2, atol=1e-5)


@pytest.mark.parametrize('seed', range(20))
def test_positive_barriers_mean_that_bodies_do_not_touch(seed):
    scene = random_scene(seed)
    for kind, least in (('agents', 0.6), ('obstacles', 0.6)):
        barrier, distances, _, _ = KINDS[kind]
        psi0 = barrier.rows(scene).psi0
        assert (distances(scene)[psi0 >= 0.0] >= least).all()


def test_agents_apart_or_close_have_one_row_a_pair_whatever_their_order():
    """Both directions are looked at: naming the robots in another order changes nothing."""
    for seed in range(20):
        scene = random_scene(seed)
        order = [2, 0, 1]
        mixed = Scene(
            scene.position[order],
            scene.velocity[order],
            scene.target[order],
            scene.held,
            False,
            scene.bodies,
        )
        barrier = KINDS['agents'][0]
        one, other = barrier.rows(scene), barrier.rows(mixed)
        assert len(one.labels) == 3
        # In the new order the pairs are (c, a), (c, b), (a, b).
        assert np.allclose(one.psi0, other.psi0[[2, 0, 1]], atol=1e-12)
        assert np.allclose(one.bound, other.bound[[2, 0, 1]], atol=1e-12)


def test_input_away_from_a_neighbour_helps():
    """A row with a flipped sign would push robots together."""
    for kind in ('agents', 'obstacles', 'walls'):
        barrier, distances, _, _ = KINDS[kind]
        scene = random_scene(3)
        rows = barrier.rows(scene)
        for row in range(len(rows.labels)):
            u = rows.coefficients[row]
            pushed, coasting = (distances(moved(scene, w, 0.1))[row] for w in (u, 0.0 * u))
            assert pushed > coasting


def test_held_agents_get_no_coefficients_and_ask_nothing_of_each_other():
    scene = random_scene(5, held=(True, True, False))
    for kind in ('agents', 'obstacles', 'walls'):
        rows = KINDS[kind][0].rows(scene)
        assert not rows.coefficients[:, :2].any()
        nobody = ~rows.coefficients.any(axis=(1, 2))
        assert nobody.any()
        assert (rows.bound[nobody] == 0.0).all()


def test_labels_name_both_sides():
    scene = random_scene(1)
    assert KINDS['agents'][0].rows(scene).labels == ('a~b', 'a~c', 'b~c')
    assert KINDS['obstacles'][0].rows(scene).labels[:3] == ('a~o', 'a~p', 'b~o')
    assert KINDS['walls'][0].rows(scene).labels[:3] == ('a~left', 'a~right', 'b~left')
