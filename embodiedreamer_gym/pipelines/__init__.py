"""Long jobs that join environments, policies, the video model and files: demonstrations, regeneration, preference studies."""

FRAME_INTERVAL = 5  # actions between generated frames of a chunk, of which a policy sees the last one alone
