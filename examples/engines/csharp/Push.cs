// A tool pushes a weightless crate for two seconds; prints the momentum of the crate and the impulse that it received.
//     hapscene serve crate.stl --unit m --swatch wood
//     mcs Push.cs HapsceneClient.cs && mono Push.exe        (or in a project of `dotnet new console`: dotnet run)
using System;
using System.Diagnostics;
using System.Globalization;
using System.Threading;
using Hapscene;

static class Push
{
    static void Main(string[] words)
    {
        CultureInfo.CurrentCulture = CultureInfo.InvariantCulture;
        const double mass = 0.2, step = 1.0 / 60.0;
        using (var client = new Client(port: words.Length > 0 ? int.Parse(words[0]) : 47700))
        {
            client.Order("free", ("body", "crate"), ("mass", mass), ("inertia", new[] { 8e-5, 8e-5, 8e-5 }));
            client.Frame(null, new Body { Name = "crate", Jumps = true });
            client.Order("start", ("p", new[] { -0.03, 0, 0 }));
            client.Poll();
            client.Take("crate");

            double x = 0, v = 0, received = 0;
            var time = Stopwatch.StartNew();
            for (int k = 0; k < 120; ++k)
            {
                Thread.Sleep(Math.Max(0, (int)(1000 * (k + 1) * step - time.ElapsedMilliseconds)));
                double[] place = { x, 0, 0 }, velocity = { v, 0, 0, 0, 0, 0 }, aim = { -0.03 + 0.05 * k * step, 0, 0 };
                client.Frame(aim, new Body { Name = "crate", Place = place, Velocity = velocity });
                client.Poll();
                double grown = client.Take("crate")[0];
                received += grown;
                v += grown / mass;
                x += v * step;
            }
            Console.WriteLine($"momentum {mass * v:R} received {received:R}");
            foreach (Event e in client.Events)
                Console.WriteLine($"{e.Tick}, {e.Kind}, {e.Body}, {e.Swatch}, {e.Speed:g3}");
        }
    }
}
