"""A part with the scan's points on its faces, and what is measured there: edges, walls, sections."""
