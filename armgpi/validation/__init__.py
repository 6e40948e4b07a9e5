"""Hand-derived dynamics beside Pinocchio's: what differs, where, and what the mistake is."""
