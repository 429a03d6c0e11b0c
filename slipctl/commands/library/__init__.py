"""Is it a command about what slipctl has: studies, models, pages, files to begin with?"""
