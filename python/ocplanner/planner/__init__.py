"""The object-centric planner: training in torch, inference in Rust."""
