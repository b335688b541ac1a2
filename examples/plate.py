import jax

import fdjax

jax.config.update("jax_enable_x64", True)
plate = fdjax.Part.plate(fdjax.rectangle(80, 80), layers=10, height=0.2)
target = fdjax.expression("0.1 + 0.4*x/80", quantity="solid")
machine = fdjax.load_machine("marlin-0.4")
result = fdjax.design(plate, target, limits=machine.limits)
build = fdjax.lay(result.strokes(), plate, lift_length=machine.lift_length, name="plate")
build = fdjax.trim(fdjax.cut_corners(build, target, window=5), result.volume)
fdjax.write_file(build.replace(origin=(70, 70)), "plate.gcode", machine)
measured = fdjax.measure(fdjax.read_file("plate.gcode"), window=5)
print(f"RMS porosity error {fdjax.compare(measured, target).rms:.4f}")
