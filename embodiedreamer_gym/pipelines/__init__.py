"""Long jobs on environments, policies, the video model and files: demonstrations, regeneration, preference studies."""

FRAME_INTERVAL = 5  # actions between generated frames of a chunk; a policy sees only the last frame
