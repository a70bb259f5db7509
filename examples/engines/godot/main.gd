# A crate without weight, pushed by a tool for three seconds; then its momentum and what the tool gave it are printed.
#     hapscene serve crate.stl --unit m --swatch wood
#     godot3-server --path examples/engines/godot        (or godot3, to see it)
extends Spatial

const Client = preload("res://hapscene_client.gd")
const SECONDS = 3.0
const SPEED = 0.03

var client = Client.new()
var time = 0.0
onready var crate = $crate


func _ready():
	var port = 47700
	for word in OS.get_cmdline_args():
		if word.begins_with("--port="):
			port = int(word.trim_prefix("--port="))
	if not client.open("127.0.0.1", port):
		print(client.error)
		get_tree().quit(1)
		set_physics_process(false)
		return
	var inertia = crate.mass * 0.05 * 0.05 / 6.0
	client.order({"order": "free", "body": "crate", "mass": crate.mass, "inertia": [inertia, inertia, inertia]})
	client.order({"order": "start", "p": [-0.04, 0.0, 0.0]})


func _physics_process(delta):
	time += delta
	client.move("crate", crate.global_transform, crate.linear_velocity, crate.angular_velocity)
	client.frame(Vector3(-0.04 + SPEED * time, 0.0, 0.0))
	client.poll()
	if client.lost:
		print("the session is lost")
		get_tree().quit(1)
		set_physics_process(false)
		return
	var grown = client.take("crate")
	crate.apply_central_impulse(grown[0])
	crate.apply_torque_impulse(grown[1])
	if time > SECONDS:
		var got = client.totals["crate"][0] - grown[0]  # what the last step has not moved yet
		print("momentum ", crate.mass * crate.linear_velocity.x, " received ", got.x, " force ", client.state["force"].x)
		print("events ", client.events)
		client.close()
		get_tree().quit(0)
