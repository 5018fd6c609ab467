"""From where scans were seen, and what the scanners looked through."""
