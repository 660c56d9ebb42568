// What caesura_messages.hpp needs of msgpack::packer, written from the msgpack specification: shortest forms.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>

struct StandIn {
    std::string bytes;

    void pack_map(std::uint32_t n) {
        if (n < 16) put(0x80 | n);
        else put(0xde), big(n, 2);
    }
    void pack_array(std::uint32_t n) { put(0x90 | n); }
    void pack_nil() { put(0xc0); }
    void pack_true() { put(0xc3); }
    void pack_false() { put(0xc2); }
    void pack(const std::string& text) {
        if (text.size() < 32) put(0xa0 | text.size());
        else put(0xd9), put(text.size());
        bytes += text;
    }
    void pack(std::uint64_t value) {
        if (value < 128) put(value);
        else if (value < 256) put(0xcc), put(value);
        else if (value < 65536) put(0xcd), big(value, 2);
        else put(0xce), big(value, 4);
    }
    void pack(std::int64_t value) {
        if (value >= 0) pack(static_cast<std::uint64_t>(value));
        else put(value);  // -1 to -32
    }
    void pack(double value) {
        std::uint64_t bits;
        std::memcpy(&bits, &value, 8);
        put(0xcb), big(bits, 8);
    }
    void pack_bin(std::uint32_t n) {
        if (n < 256) put(0xc4), put(n);
        else put(0xc5), big(n, 2);
    }
    void pack_bin_body(const char* body, std::uint32_t n) { bytes.append(body, n); }

   private:
    void put(std::uint64_t byte) { bytes += static_cast<char>(byte & 0xff); }
    void big(std::uint64_t value, int n) {
        while (n-- > 0) put(value >> (8 * n));
    }
};
