"""Labels from plans: dense rewards, how far the object is from where the planner wanted it, and hints (section 5)."""

from ocplanner.choices import Form, RewardMode
from ocplanner.rewards.config import FORMS, RewardConfig
from ocplanner.rewards.dataset import label_dataset
from ocplanner.rewards.labelling import label_demonstration
from ocplanner.rewards.labels import REWARD_MODES, LabelSettings
from ocplanner.rewards.live import LiveReward, PlanReward
from ocplanner.rewards.terms import ObjectPoses, Rewards, plan_reward

__all__ = [
    "FORMS",
    "REWARD_MODES",
    "Form",
    "LabelSettings",
    "LiveReward",
    "ObjectPoses",
    "PlanReward",
    "RewardConfig",
    "RewardMode",
    "Rewards",
    "label_dataset",
    "label_demonstration",
    "plan_reward",
]
