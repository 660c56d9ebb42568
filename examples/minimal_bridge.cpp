// A bridge in C++: a sketch, to be taken as a beginning. The same in Python, which runs: minimal_bridge.py.
//
// Needs zenoh-cpp 1.x (over zenoh-c) and msgpack-cxx:
//   g++ -std=c++17 minimal_bridge.cpp -lzenohc -DZENOHCXX_ZENOHC -o minimal_bridge
// What is checked here is caesura_messages.hpp: its bytes are those of tests/vectors. The calls of zenoh-cpp
// below were written after its examples and are not compiled by our tests.
//
// open → batches, numbered without holes → answer `replay` for what was missed → close, until acknowledged.

#include <chrono>
#include <cmath>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <thread>

#include <msgpack.hpp>
#include <zenoh.hxx>

#include "caesura_messages.hpp"

using namespace std::chrono_literals;

constexpr std::size_t BATCH = 20, RING = 6000;  // samples, batches: 120 s at 1 kHz

template <class Pack>
std::vector<std::uint8_t> packed(Pack pack) {
    msgpack::sbuffer buffer;
    msgpack::packer<msgpack::sbuffer> packer(buffer);
    pack(packer);
    return {buffer.data(), buffer.data() + buffer.size()};
}

class Bridge {
   public:
    Bridge(zenoh::Session& session, std::string station, caesura::Opening opening)
        : session_(session),
          station_(std::move(station)),
          opening_(std::move(opening)),
          token_(session.liveliness_declare_token(zenoh::KeyExpr(key("alive")))),
          replay_(session.declare_queryable(
              zenoh::KeyExpr(key("replay")), [this](const zenoh::Query& query) { answer(query); }, [] {})) {}

    void open() {
        ask([this](auto& pk) { caesura::pack_open(pk, opening_); });
    }

    /// rows: (n, columns), row by row, the time since t0 first.
    void put(std::uint64_t seq, double t0, const std::vector<double>& rows) {
        auto payload = packed([&](auto& pk) { caesura::pack_batch(pk, opening_, seq, t0, rows); });
        {
            std::lock_guard<std::mutex> held(lock_);
            ring_[seq] = payload;
            if (ring_.size() > RING) ring_.erase(ring_.begin());
        }
        send(payload);
    }

    /// Until the service has everything: what it misses, it asks for or is sent again.
    void close(std::int64_t last_seq) {
        while (true) {
            const auto ack = ask([&](auto& pk) { caesura::pack_close(pk, opening_, last_seq); });
            if (ack.at("state").template as<std::string>() == "closed") return;
            for (auto seq = ack.at("next_seq").template as<std::uint64_t>(); seq <= std::uint64_t(last_seq); ++seq)
                send(ring_.at(seq));
            std::this_thread::sleep_for(100ms);
        }
    }

   private:
    using Fields = std::map<std::string, msgpack::object>;

    std::string key(const std::string& part) const { return caesura::station_key(station_, part); }

    /// DROP: a robot must not wait for the network; what is dropped is asked for again.
    void send(const std::vector<std::uint8_t>& payload) {
        zenoh::Session::PutOptions options;
        options.encoding = zenoh::Encoding(caesura::encoding_of("SampleBatch"));
        options.congestion_control = zenoh::CongestionControl::Z_CONGESTION_CONTROL_DROP;
        session_.put(zenoh::KeyExpr(key("samples")), zenoh::Bytes(payload), std::move(options));
    }

    /// Ask until a service answers; return the Ack's fields. A refusal is thrown.
    template <class Pack>
    Fields ask(Pack pack) {
        while (true) {
            zenoh::Session::GetOptions options;
            options.payload = zenoh::Bytes(packed(pack));
            options.encoding = zenoh::Encoding(caesura::encoding_of("Control"));
            options.timeout_ms = 2000;
            auto replies = session_.get(
                zenoh::KeyExpr(key("control")), "", zenoh::channels::FifoChannel(16), std::move(options));
            for (auto got = replies.recv(); std::holds_alternative<zenoh::Reply>(got); got = replies.recv()) {
                const auto& reply = std::get<zenoh::Reply>(got);
                const auto bytes =
                    (reply.is_ok() ? reply.get_ok().get_payload() : reply.get_err().get_payload()).as_vector();
                handle_ = msgpack::unpack(reinterpret_cast<const char*>(bytes.data()), bytes.size());
                auto fields = handle_.get().as<Fields>();
                if (reply.is_ok()) return fields;
                const auto code = fields.at("code").as<std::string>();
                if (code != "overloaded" && code != "internal")
                    throw std::runtime_error(code + ": " + fields.at("message").as<std::string>());
            }
            std::this_thread::sleep_for(200ms);
        }
    }

    /// `from=3;to=9;max=100`: a reply for each batch, or `evicted` with the oldest that there is.
    void answer(const zenoh::Query& query) {
        std::map<std::string, std::uint64_t> wanted;
        std::istringstream parameters{std::string(query.get_parameters())};
        for (std::string part; std::getline(parameters, part, ';');) {
            const auto at = part.find('=');
            if (at == std::string::npos) continue;
            if (part.substr(0, at) != "session")
                wanted[part.substr(0, at)] = std::stoull(part.substr(at + 1));
            else if (part.substr(at + 1) != opening_.session)
                return;  // what another bridge had
        }
        std::lock_guard<std::mutex> held(lock_);
        if (!ring_.empty() && wanted.at("from") < ring_.begin()->first) {
            zenoh::Query::ReplyErrOptions options;
            options.encoding = zenoh::Encoding(caesura::encoding_of("Error"));
            const auto oldest = ring_.begin()->first;
            query.reply_err(zenoh::Bytes(packed([&](auto& pk) {
                                caesura::pack_evicted(pk, wanted.at("from"), oldest);
                            })),
                            std::move(options));
            return;
        }
        const auto last = std::min(wanted.at("to"), wanted.at("from") + wanted.at("max") - 1);
        for (auto found = ring_.lower_bound(wanted.at("from")); found != ring_.end() && found->first <= last; ++found) {
            zenoh::Query::ReplyOptions options;
            options.encoding = zenoh::Encoding(caesura::encoding_of("SampleBatch"));
            query.reply(zenoh::KeyExpr(key("replay")), zenoh::Bytes(found->second), std::move(options));
        }
    }

    zenoh::Session& session_;
    std::string station_;
    caesura::Opening opening_;
    std::map<std::uint64_t, std::vector<std::uint8_t>> ring_;
    std::mutex lock_;
    msgpack::object_handle handle_;
    zenoh::LivelinessToken token_;
    zenoh::Queryable<void> replay_;
};

int main(int argc, char** argv) {
    const std::string endpoint = argc > 1 ? argv[1] : "tcp/127.0.0.1:7447";
    auto config = zenoh::Config::create_default();
    config.insert_json5("mode", "\"client\"");
    config.insert_json5("connect/endpoints", "[\"" + endpoint + "\"]");
    config.insert_json5("scouting/multicast/enabled", "false");
    config.insert_json5("transport/shared_memory/enabled", "false");
    auto session = zenoh::Session::open(std::move(config));

    caesura::Opening opening;
    opening.session = "s" + std::to_string(std::time(nullptr));
    opening.columns = {"t", "px", "py", "pz"};
    opening.wrench_source = "none";
    opening.bridge = "minimal-" + std::to_string(std::time(nullptr));
    Bridge bridge(session, "cell-1", opening);
    bridge.open();

    std::uint64_t seq = 0;
    for (; seq < 250; ++seq) {  // five seconds; put the reading of your robot here
        const double t0 = double(seq * BATCH) / 1000.0;
        std::vector<double> rows;
        for (std::size_t i = 0; i < BATCH; ++i) {
            const double offset = double(i) / 1000.0;
            rows.insert(rows.end(), {offset, 0.4 + 0.1 * std::sin(2.0 * (t0 + offset)), 0.0, 0.3});
        }
        bridge.put(seq, t0, rows);
        std::this_thread::sleep_for(20ms);
    }
    bridge.close(std::int64_t(seq) - 1);
    std::cout << opening.session << " closed, " << seq << " batches\n";
}
