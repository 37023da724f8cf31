"""The public names, as type checkers see them; ``__init__.py`` imports each on first use."""

from ocplanner.demos.dataset import Demonstrations as Demonstrations
from ocplanner.demos.demonstration import Demonstration as Demonstration
from ocplanner.envs import make_env as make_env
from ocplanner.files.records.evaluation import PolicyResult as PolicyResult
from ocplanner.geometry.pose import Pose as Pose
from ocplanner.guidance.dataset import label_dataset as label_dataset
from ocplanner.guidance.live_reward import PlanReward as PlanReward
from ocplanner.guidance.rewards import RewardConfig as RewardConfig
from ocplanner.guidance.rewards import plan_reward as plan_reward
from ocplanner.guidance.settings import LabelSettings as LabelSettings
from ocplanner.planner.planner import Plan as Plan
from ocplanner.planner.planner import Planner as Planner
from ocplanner.policies.evaluate import evaluate_policy as evaluate_policy
from ocplanner.policies.policy import Policy as Policy
from ocplanner.zero_shot.settings import TransferConfig as TransferConfig
from ocplanner.zero_shot.transfer import transfer as transfer
