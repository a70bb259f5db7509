// Client of hapscene's bridge in one file of C# 7 (Unity, Mono). See docs/reference/bridge-protocol.md, version 1.
// In each step of your physics call Frame, Poll, Take, as Push.cs does. Not thread-safe.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Net.Sockets;
using System.Text;
using System.Text.RegularExpressions;

namespace Hapscene
{
    public sealed class Body
    {
        public string Name;
        public double[] Place = { 0, 0, 0 };
        public double[] Turn = { 0, 0, 0, 1 };  // quaternion x y z w
        public double[] Velocity;               // 6: of the centre of mass, angular; null: straight from frame to frame
        public bool Jumps;
    }

    public sealed class State
    {
        public ulong Tick;
        public double AgeS, Depth, Slip;
        public double[] Tool, Proxy, Normal, Force;
        public int Body, Face, Swatch;  // indices into Bodies and Swatches; -1 without contact
        public uint Flags;
    }

    public sealed class Event
    {
        public ulong Tick;
        public string Kind, Body, Swatch;  // began, crossed or ended
        public double Speed;
    }

    public sealed class Client : IDisposable
    {
        public readonly string[] Bodies, Swatches;
        public readonly List<Event> Events = new List<Event>();  // since you last emptied the list
        public State State { get; private set; }                 // the newest; null before the first
        public bool Lost { get; private set; }                   // the server was restarted, or has another client

        enum Kind : byte { Hello = 1, Welcome, Frame, State, Order, Answer, Bye, Refused }

        struct Packet
        {
            public Kind Kind;
            public ulong Key;
            public uint Sequence;
            public byte[] Payload;
        }

        static readonly string[] Kinds = { "", "began", "crossed", "ended" };
        static readonly uint[] Table = Enumerable.Range(0, 256).Select(n => Enumerable.Range(0, 8).Aggregate(
            (uint)n, (c, _) => (c & 1) != 0 ? (c >> 1) ^ 0xEDB88320u : c >> 1)).ToArray();

        readonly Socket socket = new Socket(AddressFamily.InterNetwork, SocketType.Dgram, ProtocolType.Udp);
        readonly byte[] buffer = new byte[65536];
        readonly Dictionary<string, double[]> totals = new Dictionary<string, double[]>();
        readonly Dictionary<string, double[]> seen = new Dictionary<string, double[]>();
        readonly double patience;
        bool closed;
        ulong key;
        uint sequence, orders, eventCount, last;

        /// Unity is y up, left-handed, 1. Waits up to `patience` seconds, then throws what was wrong.
        public Client(string host = "127.0.0.1", int port = 47700, string up = "y", string handed = "left",
                      double metres = 1, double patience = 10)
        {
            this.patience = patience;
            try
            {
                socket.Connect(host, port);
                uint nonce = BitConverter.ToUInt32(Guid.NewGuid().ToByteArray(), 0);
                string answer = Ask(Kind.Hello, 1, Json(new Dictionary<string, object> {
                    ["version"] = 1, ["nonce"] = nonce, ["up"] = up, ["handed"] = handed, ["metres"] = metres }));
                Bodies = Texts(answer, "bodies");
                Swatches = Texts(answer, "swatches");
            }
            catch
            {
                socket.Dispose();
                throw;
            }
            foreach (string name in Bodies) totals[name] = seen[name] = new double[6];
        }

        public void Dispose()
        {
            if (!closed) Send(Kind.Bye, 0, new byte[0]);
            closed = true;
            socket.Dispose();
        }

        /// Send an order, executed once: Order("start", ("p", new[] { 0, 0.1, 0 })). Throws if the server refuses it.
        public string Order(string order, params (string, object)[] with)
        {
            var what = new Dictionary<string, object> { ["order"] = order };
            foreach (var pair in with) what[pair.Item1] = pair.Item2;
            return Ask(Kind.Order, ++orders, Json(what));
        }

        /// Send the target of the hand (null: unchanged) and poses of bodies; call it before `Take`.
        public void Frame(double[] aim, params Body[] moved)
        {
            var bytes = new MemoryStream();
            var to = new BinaryWriter(bytes);  // little-endian on every machine, as BinaryReader
            to.Write((byte)(aim == null ? 0 : 1));
            to.Write((byte)moved.Length);
            to.Write((ushort)0);
            to.Write(eventCount);
            Put(to, aim ?? new double[3]);
            foreach (Body body in moved)
            {
                int index = Array.IndexOf(Bodies, body.Name);
                if (index < 0) throw new ArgumentException("no body " + body.Name);
                to.Write((ushort)index);
                to.Write((ushort)((body.Jumps ? 1 : 0) + (body.Velocity == null ? 0 : 2)));
                to.Write(0u);
                Put(to, body.Place);
                Put(to, body.Turn);
                Put(to, body.Velocity ?? new double[6]);
                Put(to, seen[body.Name]);
            }
            Send(Kind.Frame, ++sequence, bytes.ToArray());
        }

        /// Read the packets that have arrived; return whether a new state is among them.
        public bool Poll()
        {
            bool came = false;
            while (Receive(0) is Packet packet)
                if (packet.Kind == Kind.State && packet.Key == key) came |= TakeState(packet);
            return came;
        }

        /// Return the increase of a body's total impulse since the last call (N s, and N m s about its origin).
        public double[] Take(string name)
        {
            double[] before = seen[name];
            seen[name] = totals[name];
            return totals[name].Select((total, i) => total - before[i]).ToArray();
        }

        bool TakeState(Packet packet)
        {
            if (packet.Sequence <= last) return false;  // overtaken
            last = packet.Sequence;
            var from = new BinaryReader(new MemoryStream(packet.Payload));
            State = new State {
                Tick = from.ReadUInt64(), AgeS = from.ReadDouble(),
                Tool = Get(from, 3), Proxy = Get(from, 3), Normal = Get(from, 3), Force = Get(from, 3),
                Depth = from.ReadDouble(), Slip = from.ReadDouble(),
                Body = from.ReadInt32(), Face = from.ReadInt32(), Swatch = from.ReadInt32(), Flags = from.ReadUInt32() };
            uint number = from.ReadUInt32();
            int events = from.ReadUInt16(), bodies = from.ReadUInt16();
            for (; bodies > 0; --bodies)
            {
                string name = Bodies[from.ReadUInt16()];
                from.ReadBytes(6);
                totals[name] = Get(from, 6);
            }
            for (; events > 0; --events, ++number)
            {
                var e = new Event { Tick = from.ReadUInt64(), Kind = Kinds[from.ReadUInt16()] };
                e.Body = Bodies[from.ReadUInt16()];
                e.Swatch = Swatches[from.ReadUInt16()];
                from.ReadUInt16();
                e.Speed = from.ReadDouble();
                if (number < eventCount) continue;
                Events.Add(e);
                eventCount = number + 1;
            }
            return true;
        }

        string Ask(Kind kind, uint asked, string what)
        {
            string why = "no answer: is `hapscene serve` running?";
            for (var time = Stopwatch.StartNew(); time.Elapsed.TotalSeconds < patience;)
            {
                Send(kind, asked, Encoding.UTF8.GetBytes(what));
                while (Receive(100) is Packet packet)
                {
                    if (packet.Kind == Kind.State && packet.Key == key) TakeState(packet);
                    if (Lost) throw new InvalidOperationException("the session is lost: make a new Client");
                    bool mine = packet.Kind == kind + 1 || packet.Kind == Kind.Refused;
                    if (!mine || packet.Sequence != asked) continue;
                    string answer = Encoding.UTF8.GetString(packet.Payload);
                    if (packet.Kind == Kind.Welcome) key = packet.Key;
                    if (!answer.StartsWith("{\"error\"", StringComparison.Ordinal)) return answer;
                    why = Text(answer);
                    if (why != "another client is here") throw new InvalidOperationException(why);
                }
            }
            throw new TimeoutException(why);
        }

        void Send(Kind kind, uint number, byte[] payload)
        {
            var bytes = new MemoryStream();
            var to = new BinaryWriter(bytes);
            to.Write(Encoding.ASCII.GetBytes("HSB1"));
            to.Write((byte)kind);
            to.Write((byte)0);
            to.Write((ushort)(24 + payload.Length));
            to.Write(key);
            to.Write(number);
            to.Write(Checksum(payload, Checksum(bytes.ToArray())));
            to.Write(payload);
            try { socket.Send(bytes.ToArray()); }
            catch (SocketException) { }  // an earlier packet was refused by the port
        }

        Packet? Receive(int wait_ms)
        {
            while (socket.Poll(1000 * wait_ms, SelectMode.SelectRead))
            {
                int size;
                try { size = socket.Receive(buffer); }
                catch (SocketException) { continue; }
                if (size < 24) continue;
                byte[] data = buffer.Take(size).ToArray(), head = data.Take(20).ToArray();
                var from = new BinaryReader(new MemoryStream(data));
                if (Encoding.ASCII.GetString(from.ReadBytes(4)) != "HSB1") continue;
                var packet = new Packet { Kind = (Kind)(byte)from.ReadUInt16() };
                if (from.ReadUInt16() != size) continue;
                packet.Key = from.ReadUInt64();
                packet.Sequence = from.ReadUInt32();
                uint check = from.ReadUInt32();
                packet.Payload = from.ReadBytes(size - 24);
                if (check != Checksum(packet.Payload, Checksum(head))) continue;
                if (packet.Kind == Kind.Refused && Encoding.UTF8.GetString(packet.Payload).Contains("no such session"))
                    Lost = true;
                return packet;
            }
            return null;
        }

        static uint Checksum(byte[] data, uint before = 0)
        {
            uint c = ~before;
            foreach (byte b in data) c = (c >> 8) ^ Table[(c ^ b) & 0xFF];
            return ~c;
        }

        static void Put(BinaryWriter to, double[] numbers)
        {
            foreach (double number in numbers) to.Write(number);
        }

        static double[] Get(BinaryReader from, int count)
        {
            return Enumerable.Range(0, count).Select(_ => from.ReadDouble()).ToArray();
        }

        static string Json(object what)
        {
            if (what is string text)
                return "\"" + Regex.Replace(text, @"[\x00-\x1f""\\]", c => $"\\u{(int)c.Value[0]:x4}") + "\"";
            if (what is IDictionary map)
                return "{" + string.Join(",", map.Keys.Cast<object>().Select(k => Json(k) + ":" + Json(map[k]))) + "}";
            if (what is IEnumerable list) return "[" + string.Join(",", list.Cast<object>().Select(Json)) + "]";
            return Convert.ToDouble(what).ToString("R", CultureInfo.InvariantCulture);
        }

        const string Quoted = @"""((?:[^""\\]|\\.)*)""";

        static string Text(string json) => Regex.Unescape(Regex.Match(json, ":\\s*" + Quoted).Groups[1].Value);

        static string[] Texts(string json, string name)
        {
            string list = Regex.Match(json, $@"""{name}"":\[((?:{Quoted},?)*)\]").Groups[1].Value;
            return Regex.Matches(list, Quoted).Cast<Match>().Select(m => Regex.Unescape(m.Groups[1].Value)).ToArray();
        }
    }
}
