"""Dense rewards from plans: how far the object is from where the planner wanted it (the paper's section 5)."""

from ocplanner.rewards.config import FORMS, Form, RewardConfig
from ocplanner.rewards.labelling import label_demonstration
from ocplanner.rewards.terms import ObjectPoses, Rewards, plan_reward

__all__ = ["FORMS", "Form", "ObjectPoses", "RewardConfig", "Rewards", "label_demonstration", "plan_reward"]
