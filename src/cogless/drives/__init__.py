"""Drives that people own: their logs and configurations, and cogging tables in their own formats."""
