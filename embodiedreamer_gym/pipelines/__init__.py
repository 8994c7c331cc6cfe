"""Long jobs that join environments, policies, the video model and files: demonstrations, regeneration, preference studies."""
