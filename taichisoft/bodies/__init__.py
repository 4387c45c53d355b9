"""What is simulated: soft bodies with their elements and cavities, rigid bodies, obstacles."""
