// Client of hapscene's bridge in one header, C++17 without libraries. See docs/reference/bridge-protocol.md, version 1.
// In each step of your physics call frame, poll, take, as push.cpp does.
#pragma once
#include <array>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <locale>
#include <map>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>
#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
#pragma comment(lib, "Ws2_32.lib")
using socklen_t = int;
#else
#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#endif

namespace hapscene {

using Vector = std::array<double, 3>;
using Quaternion = std::array<double, 4>;  // x y z w
using Total = std::array<double, 6>;       // impulse [N s], angular impulse about the body's origin [N m s]

struct Body {
    std::string name;
    Vector place{};
    Quaternion turn{0, 0, 0, 1};
    std::optional<std::array<double, 6>> velocity = std::nullopt;  // of the centre of mass, and angular
    bool jumps = false;
};

struct State {
    std::uint64_t tick = 0;
    double age_s = 0;
    Vector tool{}, proxy{}, normal{}, force{};
    double depth = 0, slip = 0;
    std::int32_t body = -1, face = -1, swatch = -1;
    std::uint32_t flags = 0;
};

struct Event {
    std::uint64_t tick;
    int kind;  // 1 began, 2 crossed, 3 ended
    std::string body, swatch;
    double speed;
};

class Client {
public:
    std::vector<std::string> bodies, swatches;
    std::optional<State> state;
    std::vector<Event> events;  // since you last emptied the list
    bool lost = false;          // the server was restarted, or has another client: make a new client

    // Unreal: up "z", handed "left", metres 0.01. Waits up to `patience_s`, then throws.
    Client(const std::string& host, int port, const std::string& up = "z", const std::string& handed = "right",
           double metres = 1.0, double patience_s = 10.0)
        : patience_s_(patience_s) {
#ifdef _WIN32
        WSADATA started;
        WSAStartup(MAKEWORD(2, 2), &started);
#endif
        socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(static_cast<std::uint16_t>(port));
        inet_pton(AF_INET, host.c_str(), &to.sin_addr);
        if (::connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to) != 0) throw std::runtime_error("no socket");
        for (std::uint32_t n = 0; n < 256; ++n) {
            std::uint32_t c = n;
            for (int k = 0; k < 8; ++k) c = c & 1 ? (c >> 1) ^ 0xEDB88320u : c >> 1;
            table_[n] = c;
        }
        std::ostringstream hello;
        hello.imbue(std::locale::classic());  // a decimal point in numbers, whatever the locale
        hello << "{\"version\":1,\"nonce\":" << std::random_device{}() << ",\"up\":\"" << up << "\",\"handed\":\""
              << handed << "\",\"metres\":" << metres << "}";
        std::string answer;
        try {
            answer = ask(HELLO, 1, hello.str());
        } catch (...) {
            shut();
            throw;
        }
        bodies = names(answer, "bodies");
        swatches = names(answer, "swatches");
        for (const auto& name : bodies) totals_[name] = seen_[name] = Total{};
    }

    ~Client() {
        send(BYE, 0, {});
        shut();
    }

    Client(const Client&) = delete;
    Client& operator=(const Client&) = delete;

    // Send an order (JSON), executed once, and return its answer; throws if the server refuses it.
    std::string order(const std::string& json) { return ask(ORDER, ++orders_, json); }

    // Send poses of bodies and the target of the hand (nothing: unchanged); call it before `take`.
    void frame(const std::optional<Vector>& aim, const std::vector<Body>& moved) {
        Bytes out;
        put<std::uint8_t>(out, aim.has_value());
        put<std::uint8_t>(out, static_cast<std::uint8_t>(moved.size()));
        put<std::uint16_t>(out, 0);
        put<std::uint32_t>(out, event_count_);
        put(out, aim.value_or(Vector{}));
        for (const auto& body : moved) {
            put<std::uint16_t>(out, index(body.name));
            put<std::uint16_t>(out, static_cast<std::uint16_t>(body.jumps + 2 * body.velocity.has_value()));
            put<std::uint32_t>(out, 0);
            put(out, body.place);
            put(out, body.turn);
            put(out, body.velocity.value_or(std::array<double, 6>{}));
            put(out, seen_[body.name]);
        }
        send(FRAME, ++sequence_, out);
    }

    // Read the packets that have arrived; return whether a new state is among them.
    bool poll() {
        bool came = false;
        while (auto packet = receive(0)) {
            if (packet->kind == STATE && packet->key == key_) came = take_state(*packet) || came;
        }
        return came;
    }

    // Return the increase of a body's total impulse since the last call: apply it in this step.
    Total take(const std::string& name) {
        Total grown;
        for (int i = 0; i < 6; ++i) grown[i] = totals_[name][i] - seen_[name][i];
        seen_[name] = totals_[name];
        return grown;
    }

    const Total& total(const std::string& name) { return totals_[name]; }

private:
    enum Kind : std::uint8_t { HELLO = 1, WELCOME, FRAME, STATE, ORDER, ANSWER, BYE, REFUSED };
    using Bytes = std::vector<std::uint8_t>;
    struct Packet {
        std::uint8_t kind;
        std::uint64_t key;
        std::uint32_t sequence;
        Bytes payload;
    };

    // Numbers are little-endian on all machines that engines run on.
    template <class T>
    static void put(Bytes& out, const T& value) {
        const auto* from = reinterpret_cast<const std::uint8_t*>(&value);
        out.insert(out.end(), from, from + sizeof(T));
    }

    template <class T>
    static T get(const Bytes& from, std::size_t& at) {
        T value{};
        if (at + sizeof(T) <= from.size()) std::memcpy(&value, from.data() + at, sizeof(T));
        at += sizeof(T);
        return value;
    }

    std::uint32_t checksum(const std::uint8_t* data, std::size_t size, std::uint32_t before = 0) const {
        std::uint32_t c = before ^ 0xFFFFFFFFu;
        for (std::size_t i = 0; i < size; ++i) c = (c >> 8) ^ table_[(c ^ data[i]) & 0xFF];
        return c ^ 0xFFFFFFFFu;
    }

    void send(Kind kind, std::uint32_t sequence, const Bytes& payload) {
        Bytes out{'H', 'S', 'B', '1'};
        put<std::uint8_t>(out, kind);
        put<std::uint8_t>(out, 0);
        put<std::uint16_t>(out, static_cast<std::uint16_t>(24 + payload.size()));
        put<std::uint64_t>(out, key_);
        put<std::uint32_t>(out, sequence);
        put<std::uint32_t>(out, checksum(payload.data(), payload.size(), checksum(out.data(), out.size())));
        out.insert(out.end(), payload.begin(), payload.end());
        ::send(socket_, reinterpret_cast<const char*>(out.data()), static_cast<int>(out.size()), 0);
    }

    std::optional<Packet> receive(int wait_ms) {
        for (;;) {
#ifdef _WIN32
            WSAPOLLFD ready{socket_, POLLIN, 0};
            if (WSAPoll(&ready, 1, wait_ms) <= 0) return std::nullopt;
#else
            pollfd ready{socket_, POLLIN, 0};
            if (::poll(&ready, 1, wait_ms) <= 0) return std::nullopt;
#endif
            Bytes data(65536);
            const auto size = ::recv(socket_, reinterpret_cast<char*>(data.data()), static_cast<int>(data.size()), 0);
            if (size < 24 || std::memcmp(data.data(), "HSB1", 4) != 0) continue;
            data.resize(static_cast<std::size_t>(size));
            std::size_t at = 4;
            Packet packet{};
            packet.kind = get<std::uint8_t>(data, at);
            get<std::uint8_t>(data, at);
            const auto length = get<std::uint16_t>(data, at);
            packet.key = get<std::uint64_t>(data, at);
            packet.sequence = get<std::uint32_t>(data, at);
            const auto check = get<std::uint32_t>(data, at);
            packet.payload.assign(data.begin() + 24, data.end());
            const auto& payload = packet.payload;
            if (length != data.size() || check != checksum(payload.data(), payload.size(), checksum(data.data(), 20)))
                continue;
            const std::string answer(payload.begin(), payload.end());
            lost = lost || (packet.kind == REFUSED && answer.find("no such session") != std::string::npos);
            return packet;
        }
    }

    void shut() {
#ifdef _WIN32
        closesocket(socket_);
#else
        ::close(socket_);
#endif
    }

    bool take_state(const Packet& packet) {
        if (packet.sequence <= last_) return false;  // overtaken
        last_ = packet.sequence;
        const Bytes& from = packet.payload;
        std::size_t at = 0;
        State received;
        received.tick = get<std::uint64_t>(from, at);
        received.age_s = get<double>(from, at);
        for (Vector* vector : {&received.tool, &received.proxy, &received.normal, &received.force}) *vector = get<Vector>(from, at);
        received.depth = get<double>(from, at);
        received.slip = get<double>(from, at);
        for (std::int32_t* number : {&received.body, &received.face, &received.swatch}) *number = get<std::int32_t>(from, at);
        received.flags = get<std::uint32_t>(from, at);
        auto number = get<std::uint32_t>(from, at);
        const auto event_count = get<std::uint16_t>(from, at);
        const auto body_count = get<std::uint16_t>(from, at);
        for (int k = 0; k < body_count; ++k) {
            const auto body = get<std::uint16_t>(from, at);
            at += 6;
            totals_[bodies.at(body)] = get<Total>(from, at);
        }
        for (int k = 0; k < event_count; ++k, ++number) {
            const auto tick = get<std::uint64_t>(from, at);
            const int kind = get<std::uint8_t>(from, at);
            get<std::uint8_t>(from, at);
            const auto body = get<std::uint16_t>(from, at), swatch = get<std::uint16_t>(from, at);
            at += 2;
            const double speed = get<double>(from, at);
            if (number < event_count_) continue;
            events.push_back({tick, kind, bodies.at(body), swatches.at(swatch), speed});
            event_count_ = number + 1;
        }
        state = received;
        return true;
    }

    std::string ask(Kind kind, std::uint32_t sequence, const std::string& what) {
        std::string why = "no answer: is `hapscene serve` running?";
        const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience_s_);
        while (std::chrono::steady_clock::now() < end) {
            send(kind, sequence, Bytes(what.begin(), what.end()));
            while (auto packet = receive(100)) {
                if (packet->kind == STATE && packet->key == key_) take_state(*packet);
                if (lost) throw std::runtime_error("the session is lost: make a new client");
                if ((packet->kind != kind + 1 && packet->kind != REFUSED) || packet->sequence != sequence) continue;
                const std::string answer(packet->payload.begin(), packet->payload.end());
                if (packet->kind == WELCOME) key_ = packet->key;
                if (answer.rfind("{\"error\"", 0) != 0) return answer;
                why = answer;
                if (answer.find("another client is here") == std::string::npos) throw std::runtime_error(why);
            }
        }
        throw std::runtime_error(why);
    }

    std::uint16_t index(const std::string& name) const {
        for (std::size_t i = 0; i < bodies.size(); ++i)
            if (bodies[i] == name) return static_cast<std::uint16_t>(i);
        throw std::out_of_range("no body " + name);
    }

    // The strings of a list in JSON: names, in which quotes and backslashes are escaped.
    static std::vector<std::string> names(const std::string& json, const std::string& key) {
        std::vector<std::string> found;
        auto at = json.find("\"" + key + "\":[");
        if (at == std::string::npos) return found;
        for (at = json.find('[', at) + 1; at < json.size() && json[at] != ']'; ++at) {
            if (json[at] != '"') continue;
            std::string name;
            for (++at; at < json.size() && json[at] != '"'; ++at) {
                if (json[at] == '\\') ++at;
                name += json[at];
            }
            found.push_back(name);
        }
        return found;
    }

#ifdef _WIN32
    SOCKET socket_;
#else
    int socket_;
#endif
    double patience_s_;
    std::uint64_t key_ = 0;
    std::uint32_t sequence_ = 0, orders_ = 0, event_count_ = 0, last_ = 0;
    std::map<std::string, Total> totals_, seen_;
    std::array<std::uint32_t, 256> table_{};
};

}  // namespace hapscene
