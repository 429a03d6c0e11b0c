"""Does it hand answers to a browser: processes, websocket, guard, the files of the page?"""
