"""The plan's hint in robomimic's own BC and BC-RNN.

Importing this registers with robomimic 0.5, in the two registries that it has for this: a configuration class for
``algo_name: "bc"`` with the extra section ``algo.ocp_hint``, and a factory that makes the algorithm with the hint where
``algo.ocp_hint.enabled`` is true, and robomimic's own everywhere else::

    import ocplanner.integrations.robomimic
    from robomimic.config import config_factory
    from robomimic.scripts.train import train

``python -m ocplanner.integrations.robomimic train --config FILE.json`` runs robomimic's script ``train.py`` so;
:func:`export_policy` makes a policy file of ours from its checkpoint.

Raises:
    VersionError: robomimic is not installed, or is not 0.5.
"""

from ocplanner.versions import check_pin

check_pin("praxis-robomimic")

from ocplanner.integrations.robomimic.algorithms import HintedBC, HintedBCRNN  # noqa: E402
from ocplanner.integrations.robomimic.config import HintedBCConfig  # noqa: E402
from ocplanner.integrations.robomimic.export import export_policy  # noqa: E402

__all__ = ["HintedBC", "HintedBCConfig", "HintedBCRNN", "export_policy"]
