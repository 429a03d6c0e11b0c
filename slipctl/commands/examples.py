"""Examples that ``--help`` shows; each is one that may be typed, line by line."""

from __future__ import annotations

EPILOG = """\
NAME is a study (subway_braking) or a loop of it (subway_braking:sta, or sta@real for the form that
it has in scenario real). It may be a model (double_exponential, subway_braking.wheelset) or a block
in a file (my_law.py:my_law, my_law.toml:law). It may also be an equation, such as
"mu = c*v_s where v_s [m/s], c = 0.1 s/m".

  slipctl run subway_braking --set m=8.2t --loop sta --scenario base
  slipctl run subway_braking --swap adh=my_law.py:my_law --out out/mine
  slipctl show "T = min(g*e, T_max) where e [m/s], g = 9 kN s, T_max = 8 kN m"
"""

OF_COMMAND = {
    "list": """\
  slipctl list kinds
  slipctl list sensor
  slipctl list observer --json
""",
    "show": """\
  slipctl show subway_braking:sta
  slipctl show metro.toml:pid
  slipctl show "mu = c*v_s where v_s [m/s], c = 0.1 s/m"
""",
    "new": """\
  slipctl new metro
  slipctl new metro my_car.toml
  slipctl new --from hst_braking:eppfc
  slipctl new --from subway_braking:sta@curves curves.toml
""",
    "open": """\
The page is served on this machine alone; the address holds its key.

  slipctl open
  slipctl open metro.toml --python my_law.py
  slipctl open hst_braking:eppfc --port 8765 --no-browser
""",
    "schema": """\
  slipctl schema > slipctl.schema.json
""",
    "copy": """\
  slipctl copy double_exponential my_law.py
  slipctl run subway_braking --swap adh=my_law.py:double_exponential
""",
    "run": """\
  slipctl run metro.toml
  slipctl run metro.toml --loop pid --set m=42t --out out/heavy
  slipctl run hst_braking --full
""",
    "sweep": """\
Each run is stored as soon as it ends. The same command resumes a stopped sweep; a larger --samples
extends it.

  slipctl sweep hst_braking:eppfc --vary ctl.law.K1=5:50:10 --out out/grid
  slipctl sweep hst_braking:eppfc --vary ctl.law.K1=5:50 m=28t:42t --samples 1000 --out out/draws
  slipctl sweep hst_braking:eppfc --vary ctl.law.K1=5:50 m=28t:42t --samples 2000 --out out/draws
  slipctl sweep hst_braking:eppfc --vary m=28t:42t --samples 9000 --scheduler tcp://10.0.0.5:8786 \\
      --out out/masses
""",
    "tune": """\
The search starts with the gains set by hand. It runs only gains that have a certificate. The same
command resumes a stopped search.

  slipctl tune subway_braking:sta --free k1=1:60 k2=1:60 --minimise distance --out out/sta
  slipctl tune hst_braking:eppfc --free K1=5:50 --minimise slip_error_rms \\
      --subject-to 'torque_ripple<=8kN m' 'margin>=1.2' --samples 40 --out out/eppfc
  slipctl run subway_braking --loop sta --set out/sta/gains.toml
""",
    "replay": """\
  slipctl replay run7.csv --with hst_braking:eppfc.ctl.filter \\
      --map omega='WheelSpeed_1[km/h] / r' T_b='BrakeTorque[kN m]' --out out/run7
  slipctl replay run7.csv --with "v = omega*r where omega [rad/s], r = 0.43 m" \\
      --map omega=Axle_1 --beside v=GPS_speed[km/h] --out out/run7
""",
    "compare": """\
  slipctl run hst_braking --loop eppfc --out out/a
  slipctl run hst_braking --loop eppfc --set ctl.law.K1=50 --out out/b
  slipctl compare out/a out/b
""",
    "fit": """\
  slipctl fit curve.csv --law burckhardt --out fit
  slipctl fit curve.csv --law polach --set Q=106.7kN v=10m/s --out fit
  slipctl fit coast.csv --law coasting --map v=Speed[km/h] --set m=38t rho=6.6% --out fit
  slipctl fit steps.csv --law brake_step --map 'T_cmd=Command[%]*T_max' T=Torque[kNm] \\
      --set T_max=8kNm --delay T_cmd --out fit
""",
    "c": """\
  slipctl c subway_braking:sta --out c_sta --check
  slipctl c metro.toml:pid --real float --target cortex-m4 --out c_pid
""",
    "pil": """\
  slipctl pil subway_braking:sta --seconds 0.5
  slipctl pil metro.toml:pid --real float --fault 20=lost
""",
    "certify": """\
  slipctl certify super_twisting --set k1=1.5 k2=1.1 L=1 --out sta.json
  slipctl certify subway_braking:sta
  slipctl certify subway_braking:sta --set m=9t ctl.law.k1=30
  slipctl certify subway_braking:sta --map k1=2:30,k2=2:30 --out map
  slipctl certify reaching_law --set g1=36 g2=12 T=.001 D=2 band=.1 --largest lag --out ends
""",
    "check": """\
  slipctl check sta.json
  slipctl check out/sta/certificate.json --rerun 3
""",
    "docs": """\
  slipctl docs
  slipctl docs sweeps --where
""",
}
"""Text below the options of each command."""
