"""Zero-shot transfer: grasp, then make the object follow the plan."""
