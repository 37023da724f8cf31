"""Makes the tasks known to Gymnasium as ``ocplanner/<Task>-v0``; done by ``import ocplanner`` where it is installed."""

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
