"""Does it show law, run, region and C beside each other while a person edits? The page of ``open``.

All that the page shows comes from functions here that a script can call too: :class:`desk.Desk`
holds what is open and answers. ``web`` hands the answers to a browser and knows no railway.
"""
