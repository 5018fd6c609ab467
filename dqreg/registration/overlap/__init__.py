"""What scan and target have in common at the pose of a fit: faces of both, and the space looked through."""
