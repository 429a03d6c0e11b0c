"""High-speed train with motors and its anti-slip control; Wang et al., Appl. Sci. 2025."""
