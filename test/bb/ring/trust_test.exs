defmodule BB.Ring.TrustTest do
  # Not async: the configuration's trust is that of the whole VM. Only root can act as another
  # user. For any other user the file stays its own (`mine?`), and these tests test nothing.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Ring
  alias BB.Ring.{Publisher, Subscriber}

  setup do
    topic = BB.Test.Native.topic()
    {:ok, publisher} = Publisher.open(topic)
    :ok = Publisher.publish(publisher, "bait")
    # A copy of the file carries no lock, like the file of a publisher that died.
    :ok = File.cp(path(topic), path(topic) <> ".copy")
    :ok = Publisher.close(publisher)
    :ok = File.rename(path(topic) <> ".copy", path(topic))
    {:ok, topic: topic, mine?: File.chown(path(topic), 65_534) != :ok}
  end

  test "is refused by publishers, with its owner's name", %{topic: topic, mine?: mine?} do
    unless mine? do
      assert {:error, {:foreign_owner, path, 65_534, _name} = reason} = Publisher.open(topic)
      assert path == path(topic)
      words = Ring.format_error(reason)
      assert words =~ "belongs to user 65534"
      assert words =~ "trusted_users: [65534]"
    end
  end

  test "is read and inspected whatever its owner does to it", %{topic: topic, mine?: mine?} do
    unless mine? do
      script = "while :; do truncate -s 0 $0; truncate -s 1300 $0; cat $1 > $0; done"
      bait = Path.join(System.tmp_dir!(), topic)
      File.cp!(path(topic), bait)
      args = [:binary, args: ["-c", script, path(topic), bait]]
      port = Port.open({:spawn_executable, "/bin/sh"}, args)
      {:os_pid, os_pid} = Port.info(port, :os_pid)

      # The shell of a port leads a process group, which contains the programs that it calls.
      on_exit(fn ->
        assert {_, 0} = System.cmd("kill", ["-KILL", "--", "-#{os_pid}"])
        File.rm(bait)
      end)

      # Until the owner has begun, and then for a while.
      eventually(fn -> look(topic) == :error end, 30_000)
      for _ <- 1..3000, do: look(topic)
      {:ok, %{ref: ref}} = Subscriber.open(topic, active: true, start: :latest)
      for _ <- 1..200, do: {:error, _} = Publisher.open(topic)
      assert_receive {:bb_ring, ^ref, _news}, 30_000
      Port.close(port)
    end
  end

  test "may belong to any user whom the configuration trusts", %{topic: topic, mine?: mine?} do
    unless mine? do
      trust(trusted_users: [65_534])
      assert {:ok, publisher} = Publisher.open(topic)
      assert {:ok, %{published: 1, epoch: 1}} = Publisher.info(publisher)
      trust(nil)
      assert {:ok, %{published: 1}} = Ring.info(topic)
    end
  end

  test "is trusted by no invalid list, which raises", %{topic: topic} do
    for bad <- [[trusted_users: 1001], [trusted_user: []], [trusted_groups: [-1]], :all] do
      trust(bad)
      error = assert_raise ArgumentError, fn -> Ring.info(topic) end
      assert error.message =~ "config :ganglion, BB.Ring: expected"
      assert error.message =~ inspect(bad)
    end

    trust(trusted_users: ["no such user"])
    assert_raise ArgumentError, ~r/got: "no such user"/, fn -> Publisher.open(topic) end
  end

  defp trust(nil), do: Application.delete_env(:ganglion, BB.Ring)

  defp trust(configured) do
    Application.put_env(:ganglion, BB.Ring, configured)
    on_exit(fn -> Application.delete_env(:ganglion, BB.Ring) end)
  end

  defp look(topic) do
    case Ring.info(topic) do
      {:ok, %{topic: ^topic}} -> :data
      {:error, {:not_a_ring, _path, _text}} -> :error
    end
  end

  defp path(topic), do: "/dev/shm/conduit_#{topic}"
end
