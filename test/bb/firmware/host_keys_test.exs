defmodule BB.Firmware.HostKeysTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Firmware.{HostKeys, Init}

  @moduletag :tmp_dir

  @damaged [
    empty: "",
    "of zeros": :binary.copy(<<0>>, 400),
    "cut short": "-----BEGIN OPENSSH PRIVATE KEY-----\nb3BlbnNzaC1rZXktdjEA",
    "without a key":
      "-----BEGIN OPENSSH PRIVATE KEY-----\nAAAA\n-----END OPENSSH PRIVATE KEY-----\n"
  ]

  for {what, content} <- @damaged, name <- ~w(ssh_host_ed25519_key ssh_host_rsa_key) do
    test "a host key #{name} that is #{what} is renamed and logged", %{tmp_dir: folder} do
      file = Path.join(folder, unquote(name))
      File.write!(file, unquote(content))

      log = capture_log(fn -> assert HostKeys.set_aside_damaged(folder) == [file] end)

      assert log =~ "renamed to #{file}.corrupt"
      refute File.exists?(file)
      assert File.read!(file <> ".corrupt") == unquote(content)
      assert HostKeys.set_aside_damaged(folder) == []
    end
  end

  test "a good host key stays", %{tmp_dir: folder} do
    file = Path.join(folder, "ssh_host_rsa_key")
    key = :public_key.generate_key({:rsa, 2048, 65_537})
    File.write!(file, :public_key.pem_encode([:public_key.pem_entry_encode(:RSAPrivateKey, key)]))

    assert HostKeys.set_aside_damaged(folder) == []
    assert File.exists?(file)
  end

  test "a folder that is not there has no damaged keys", %{tmp_dir: folder} do
    assert HostKeys.set_aside_damaged(Path.join(folder, "none")) == []
  end

  test "a board's start sets damaged keys aside once /data is mounted, and leaves no process", %{
    tmp_dir: folder
  } do
    file = Path.join(folder, "ssh_host_ed25519_key")
    mount = fn -> File.write!(file, "damaged") end

    capture_log(fn -> assert Init.start_link(mount: mount, keys: folder) == :ignore end)
    assert File.exists?(file <> ".corrupt")
  end
end
