"""Certificates of Wang 2025: adhesion observer, higher-order sliding mode, compensation."""
