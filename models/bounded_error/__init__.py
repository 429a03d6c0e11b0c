"""One error held inside bounds, as Zhang 2021 and Cheng 2022 do: what can be proved of it."""
