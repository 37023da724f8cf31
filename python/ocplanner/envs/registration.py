"""Registers the tasks with Gymnasium as ``ocplanner/<Task>-v0``.

``import ocplanner`` runs this, so it is a module of its own that loads no simulator.
"""

from gymnasium.envs import registration

from ocplanner.envs.tasks import tasks


def register() -> None:
    """Register every task that is not registered yet."""
    for name in tasks():
        identifier = f"ocplanner/{name}-v0"
        if identifier not in registration.registry:
            registration.register(
                identifier,
                entry_point="ocplanner.envs.gymnasium_env:GymnasiumEnv",
                vector_entry_point="ocplanner.envs.vector_env:ProcessVectorEnv",
                kwargs={"task": name},
            )
