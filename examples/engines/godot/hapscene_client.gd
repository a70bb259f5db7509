# Client of hapscene's bridge in one file, for Godot 3 (GDScript). See docs/reference/bridge-protocol.md, version 1.
# Call open, and the orders free and start, once; then in each _physics_process move, frame, poll, take. See main.gd.
extends Reference

enum {HELLO = 1, WELCOME, FRAME, STATE, ORDER, ANSWER, BYE, REFUSED}
const KINDS = {1: "began", 2: "crossed", 3: "ended"}

var bodies = []  # names; packets refer to a body by its index here
var swatches = []
var totals = {}  # total impulse of the tool on each body, by name: [linear Vector3, angular Vector3]
var state = {}  # tick, age_s, tool, proxy, normal, force, depth, slip, body, face, swatch, flags
var events = []  # [tick, kind, body, swatch, speed], since you last emptied the list
var error = ""
var lost = false  # the server was restarted, or has another client: open a new client

var _udp = PacketPeerUDP.new()
var _key = 0
var _sequence = 0
var _orders = 0
var _event_count = 0
var _last = 0
var _moving = []
var _seen = {}
var _table = []


func open(host, port, patience_s = 10.0):
	for n in 256:
		for _i in 8:
			n = (n >> 1) ^ 0xEDB88320 if n & 1 else n >> 1
		_table.append(n)
	_udp.connect_to_host(host, port)
	randomize()
	var hello = {"version": 1, "nonce": randi(), "up": "y", "handed": "right", "metres": 1.0}
	var answer = _ask(HELLO, 1, hello, patience_s)
	if answer.has("error"):
		error = answer["error"]
		return false
	bodies = answer["bodies"]
	swatches = answer["swatches"]
	for name in bodies:
		totals[name] = [Vector3(), Vector3()]
		_seen[name] = [Vector3(), Vector3()]
	return true


# Send an order, executed once; returns a Dictionary with "done" or "error".
func order(what, patience_s = 10.0):
	_orders += 1
	return _ask(ORDER, _orders, what, patience_s)


# Return the increase of a body's total impulse since the last call: apply it in this physics step.
func take(name):
	var grown = [totals[name][0] - _seen[name][0], totals[name][1] - _seen[name][1]]
	_seen[name] = totals[name].duplicate()
	return grown


# Add the pose of a body to the next frame; call it before `take`.
func move(name, transform, velocity, turning, jumps = false):
	_moving.append([name, transform, velocity, turning, jumps, _seen[name].duplicate()])


# Send the poses, and the target of the hand (null: unchanged).
func frame(aim = null):
	var out = StreamPeerBuffer.new()
	out.put_u8(0 if aim == null else 1)
	out.put_u8(_moving.size())
	out.put_u16(0)
	out.put_u32(_event_count)
	_put_vector(out, Vector3() if aim == null else aim)
	for body in _moving:
		var q = body[1].basis.get_rotation_quat()
		out.put_u16(bodies.find(body[0]))
		out.put_u16(2 + (1 if body[4] else 0))
		out.put_u32(0)
		_put_vector(out, body[1].origin)
		for number in [q.x, q.y, q.z, q.w]:
			out.put_double(number)
		for vector in [body[2], body[3], body[5][0], body[5][1]]:
			_put_vector(out, vector)
	_moving.clear()
	_sequence += 1
	_send(FRAME, _sequence, out.data_array)


# Read the packets that have arrived; return whether a new state is among them.
func poll():
	var came = false
	while _udp.get_available_packet_count() > 0:
		var packet = _unpack(_udp.get_packet())
		if packet and packet[0] == STATE and packet[1] == _key:
			came = _take_state(packet[2], packet[3]) or came
	return came


func close():
	_send(BYE, 0, PoolByteArray())
	_udp.close()


func _take_state(sequence, from):
	if sequence <= _last:
		return false  # overtaken
	_last = sequence
	state = {"tick": from.get_u64(), "age_s": from.get_double()}
	for name in ["tool", "proxy", "normal", "force"]:
		state[name] = _get_vector(from)
	for name in ["depth", "slip"]:
		state[name] = from.get_double()
	for name in ["body", "face", "swatch"]:
		state[name] = from.get_32()
	state["flags"] = from.get_u32()
	var number = from.get_u32()
	var event_count = from.get_u16()
	for _i in from.get_u16():
		var name = bodies[from.get_u16()]
		from.get_data(6)
		totals[name] = [_get_vector(from), _get_vector(from)]
	for _i in event_count:
		var event = [from.get_u64(), KINDS[from.get_u8()]]
		from.get_u8()
		event += [bodies[from.get_u16()], swatches[from.get_u16()]]
		from.get_u16()
		event.append(from.get_double())
		if number >= _event_count:
			events.append(event)
			_event_count = number + 1
		number += 1
	return true


func _ask(kind, sequence, what, patience_s):
	var answer = {"error": "no answer: is `hapscene serve` running?"}
	var end = OS.get_ticks_msec() + 1000.0 * patience_s
	while OS.get_ticks_msec() < end:
		_send(kind, sequence, JSON.print(what).to_utf8())
		for _i in 20:
			OS.delay_msec(5)
			while _udp.get_available_packet_count() > 0:
				var packet = _unpack(_udp.get_packet())
				if not packet:
					continue
				if lost:
					return {"error": "the session is lost: open a new client"}
				var mine = packet[0] == REFUSED or packet[0] == kind + 1
				if mine and packet[2] == sequence:
					_key = packet[1] if packet[0] == WELCOME else _key
					answer = JSON.parse(packet[3].get_utf8_string(packet[3].get_available_bytes())).result
					if answer.get("error") != "another client is here":
						return answer
				if packet[0] == STATE and packet[1] == _key:
					_take_state(packet[2], packet[3])
	return answer


func _send(kind, sequence, payload):
	var out = StreamPeerBuffer.new()
	out.put_data("HSB1".to_ascii())
	out.put_u8(kind)
	out.put_u8(0)
	out.put_u16(24 + payload.size())
	out.put_u64(_key)
	out.put_u32(sequence)
	out.put_u32(_crc(payload, _crc(out.data_array, 0)))
	out.put_data(payload)
	_udp.put_packet(out.data_array)


# Return [kind, key, sequence, payload]; null if the data is not a valid packet.
func _unpack(data):
	if data.size() < 24 or data.subarray(0, 3).get_string_from_ascii() != "HSB1":
		return null
	var from = StreamPeerBuffer.new()
	from.data_array = data
	from.seek(4)
	var kind = from.get_u8()
	from.get_u8()
	var size = from.get_u16()
	var key = from.get_u64()
	var sequence = from.get_u32()
	var check = _crc(data.subarray(0, 19), 0)
	if data.size() > 24:
		check = _crc(data.subarray(24, -1), check)
	if size != data.size() or from.get_u32() != check:
		return null
	if kind == REFUSED and "no such session" in data.subarray(24, -1).get_string_from_utf8():
		lost = true
	return [kind, key, sequence, from]


func _crc(data, before):
	var n = before ^ 0xFFFFFFFF
	for byte in data:
		n = (n >> 8) ^ _table[(n ^ byte) & 0xFF]
	return n ^ 0xFFFFFFFF


func _put_vector(out, vector):
	out.put_double(vector.x)
	out.put_double(vector.y)
	out.put_double(vector.z)


func _get_vector(from):
	return Vector3(from.get_double(), from.get_double(), from.get_double())
