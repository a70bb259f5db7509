// A tool pushes a weightless crate for two seconds; prints the momentum of the crate and the impulse that it received.
//     hapscene serve crate.stl --unit m --swatch wood
//     g++ -std=c++17 -o push push.cpp && ./push
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "hapscene_client.hpp"

int main(int count, char** words) {
    const double mass = 0.2, step_s = 1.0 / 60.0;
    hapscene::Client client("127.0.0.1", count > 1 ? std::atoi(words[1]) : 47700);
    client.order(R"({"order": "free", "body": "crate", "mass": 0.2, "inertia": [8e-5, 8e-5, 8e-5]})");
    client.frame({}, {{"crate", {}, {0, 0, 0, 1}, {}, true}});
    client.order(R"({"order": "start", "p": [-0.03, 0, 0]})");
    client.poll();
    client.take("crate");

    double x = 0, v = 0, received = 0;
    auto next = std::chrono::steady_clock::now();
    for (int k = 0; k < 120; ++k) {
        std::this_thread::sleep_until(next += std::chrono::microseconds(16667));
        hapscene::Body crate{"crate", {x, 0, 0}};
        crate.velocity = {v, 0, 0, 0, 0, 0};
        client.frame(hapscene::Vector{-0.03 + 0.05 * k * step_s, 0, 0}, {crate});
        client.poll();
        const double grown = client.take("crate")[0];
        received += grown;
        v += grown / mass;
        x += v * step_s;
    }
    std::printf("momentum %.9g received %.9g\n", mass * v, received);
    const char* kinds[] = {"", "began", "crossed", "ended"};
    for (const auto& e : client.events)
        std::printf("%llu, %s, %s, %s, %.3g\n", (unsigned long long)e.tick, kinds[e.kind], e.body.c_str(), e.swatch.c_str(), e.speed);
    return 0;
}
