"""The controller "closed-loop": grasps by feel."""
