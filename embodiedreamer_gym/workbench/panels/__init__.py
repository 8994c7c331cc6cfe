"""The parts of the page beside the scene; each only shows a session and asks for actions."""
