//! From the object pose that a plan asks for to a normalised OSC_POSE action.
