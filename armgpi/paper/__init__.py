"""The paper this package grew from, word for word and number for number.

Takes nothing but its tables.
Gives its arm, laws and runs (``armgpi reproduce``), beside which everything else is checked.

Galvan-Perez, D.; Yañez-Badillo, H.; Beltran-Carbajal, F.; Rivas-Camero, I.; Favela-Contreras, A.;
Tapia-Olvera, R. "Neural Adaptive Robust Motion-Tracking Control for Robotic Manipulator Systems",
Actuators 2022, 11, 255, https://doi.org/10.3390/act11090255 (CC BY 4.0).

Equation, table and section numbers in this subpackage are the paper's. Where a printed equation
does not hold, the corrected one is implemented, the line says so, and a test shows the printed form
wrong.
"""
